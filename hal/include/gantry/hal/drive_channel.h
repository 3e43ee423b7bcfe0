#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>

#include "gantry/foundation/clock.h"
#include "gantry/foundation/error.h"
#include "gantry/foundation/real_time_mutex.h"
#include "gantry/hal/drive.h"

namespace gantry {

enum class DriveAction : uint8_t { kServoOn, kServoOff, kHome, kMove, kHalt, kResetAlarm };

struct DriveCommand {
  DriveAction action = DriveAction::kHalt;
  MoveCommand move;  ///< For kMove, in axis coordinates.
};

/// What is known of a drive without asking it: a plain copy, made in the drive's own time.
struct DriveSnapshot {
  DriveStatus status;  ///< Of the last reading that succeeded; positions in axis coordinates.
  bool read = false;   ///< There was one.
  /// Commands up to this number (DriveChannel::posted()) had been executed, or dropped for a more urgent
  /// one, before `status` was read. What a status tells of earlier commands only is no news.
  uint64_t executed = 0;
  uint64_t faults = 0;                          ///< Exchanges that failed, ever: a change is a new fault.
  FaultKind last_fault = FaultKind::kProtocol;  ///< Of the last one.
  uint64_t stalls = 0;  ///< How often the drive was halted because the loop stood still.

  double age_s(double now_s) const { return now_s - status.sampled_at_s; }
};

/// When a control loop last turned, for those who watch it.
class LoopHeartbeat {
 public:
  void beat(double now_s) { last_s_.store(now_s, std::memory_order_relaxed); }
  double last_s() const { return last_s_.load(std::memory_order_relaxed); }

 private:
  std::atomic<double> last_s_{0};
};

/// Wakes the thread that services a channel. wake() neither blocks nor allocates.
class Waker {
 public:
  virtual ~Waker() = default;
  virtual void wake() = 0;
};

/// The non-blocking front of one Drive. A control loop posts commands and looks at snapshots; a thread
/// of its own (one for each bus) calls service(), which alone talks to the drive and may block for as
/// long as the bus takes.
///
/// Order: halt and torque-off overtake what waits and void it; both are owed until the drive has taken
/// them, however often that fails. Any other command that fails voids those behind it. So nothing
/// is executed after it was overtaken, or on the strength of something that did not happen.
class DriveChannel {
 public:
  static constexpr size_t kCapacity = 8;

  /// `position_at_home`: the axis position at which the drive reads zero after homing.
  DriveChannel(Drive& drive, Clock& clock, double position_at_home = 0);

  /// Never blocks for I/O, never allocates. False when the queue is full: the command is not taken.
  bool post(const DriveCommand& command);
  /// The number of the command posted last, from 1.
  uint64_t posted() const;
  DriveSnapshot latest() const;

  /// Executes what waits, reads the status, publishes it. One thread at a time.
  void service();
  /// Opens the connection and reads once: service() in the caller's time, with the fault as an answer.
  Result<void> connect();

  /// From now on service() halts the drive when the loop has not turned for `limit_s`. Both pointers
  /// may be null and must outlive the channel's use.
  void watch(const LoopHeartbeat* loop, double limit_s, Waker* waker);

  /// The last fault in words. Allocates: not for the loop.
  Fault last_fault() const;
  Drive& drive() { return drive_; }
  const Drive& drive() const { return drive_; }

 private:
  struct Numbered {
    DriveCommand command;
    uint64_t number = 0;
  };
  std::optional<Numbered> take();
  void finished(const Numbered& command);
  Result<void> execute(const DriveCommand& command);
  void watch_the_loop(double now_s);
  void failed(const Fault& fault);

  Drive& drive_;
  Clock& clock_;
  const double position_at_home_;

  mutable RealTimeMutex mutex_;  ///< Guards what follows; held for copies only.
  std::array<Numbered, kCapacity> queue_{};
  size_t first_ = 0, waiting_ = 0;
  uint64_t halt_owed_ = 0, servo_off_owed_ = 0;  ///< Their numbers; 0: none.
  uint64_t posted_ = 0, executed_ = 0;
  DriveSnapshot snapshot_;
  const LoopHeartbeat* loop_ = nullptr;
  double stall_limit_s_ = 0;
  Waker* waker_ = nullptr;

  bool stalled_ = false;  ///< Of the servicing thread.
  mutable std::mutex text_mutex_;
  Fault last_fault_;
};

}  // namespace gantry
