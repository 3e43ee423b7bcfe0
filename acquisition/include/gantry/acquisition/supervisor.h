#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "gantry/acquisition/motion_permit.h"
#include "gantry/foundation/real_time_mutex.h"
#include "gantry/hal/axis.h"

namespace gantry {

/// What a Supervisor can hold: its memory is fixed when it is made.
inline constexpr size_t kMaxAxes = 16;
using AxisSet = uint32_t;  ///< Bit i: axis i.
constexpr AxisSet axis_bit(size_t axis) {
  return AxisSet{1} << axis;
}

struct MotionRequest {
  AxisTrigger command = AxisTrigger::kStop;  ///< One of kAxisCommands; kStop and kReset are for all axes.
  AxisSet axes = 0;
  std::array<MoveCommand, kMaxAxes> moves{};  ///< For kMove and kJog.
  /// kJog: the motion stops when keep_alive() is not heard for the dead-man time.
  bool hold_to_run = false;
};

/// One axis as the loop saw it in its last cycle.
struct AxisFigures {
  AxisState state = AxisState::kDisabled;
  AxisError error;
  DriveSnapshot drive;
  double target = 0;
  bool pending = false;  ///< Enable or reset is not confirmed yet.
};

struct SupervisorStatus {
  std::array<AxisFigures, kMaxAxes> axes{};
  uint64_t cycles = 0;
  double now_s = 0;
  uint64_t answered = 0;  ///< The last request that was taken or refused.
  AxisRefusal refusal = AxisRefusal::kNone;
  size_t refused_axis = 0;
  StopCategory stop = StopCategory::kNone;  ///< As the permit demands it now.
  size_t first_failed = 0;                  ///< The axis whose error stopped the others, if one did.
  bool dead_man_released = false;           ///< The last jog ended because the keep-alive stopped.
};

struct SupervisorSettings {
  double period_s = 0.01;      ///< Of the loop.
  double stall_limit_s = 0.2;  ///< A loop that stands still for longer has its drives halted.
  double dead_man_s = 0.3;     ///< A held jog stops when the keep-alive is older.
};
/// Throws InputError.
void require_sound(const SupervisorSettings& settings);

/// The control loop's step over all axes. It takes the snapshots of all channels, asks the safety permit,
/// lets every state machine follow, and couples them: whatever puts one axis into ErrorStop stops all, in
/// the same cycle. tick() does no I/O, never waits for it, and never allocates.
///
/// Requests come from another thread. A request for several axes is taken for all of them or for none.
class Supervisor {
 public:
  /// The axes and the permit (null: none is needed) outlive the supervisor. Throws InputError for more than
  /// kMaxAxes axes.
  Supervisor(std::vector<Axis*> axes, const SupervisorSettings& settings, MotionPermit* permit);

  /// One cycle; by one thread only.
  void tick(double now_s);

  // Any thread.
  /// The number under which status() answers; 0 when the request before has not been looked at yet.
  uint64_t request(const MotionRequest& request);
  /// Halts every powered axis, from the next cycle on; overtakes requests. With an error, the axes need
  /// a reset afterwards.
  void stop(bool as_error);
  void keep_alive(double now_s) { alive_s_.store(now_s, std::memory_order_relaxed); }
  SupervisorStatus status() const;

  const LoopHeartbeat& heartbeat() const { return heartbeat_; }
  const SupervisorSettings& settings() const { return settings_; }
  const std::vector<Axis*>& axes() const { return axes_; }

 private:
  enum class Stop : uint8_t { kNone, kControlled, kError };
  struct Refused {
    AxisRefusal refusal = AxisRefusal::kNone;
    size_t axis = 0;
  };

  void couple(double now_s);
  void obey_permit(double now_s);
  void obey_stop(double now_s);
  void watch_the_dead_man(double now_s);
  void answer_request(double now_s);
  Refused check(const MotionRequest& request) const;
  Refused start(const MotionRequest& request, double now_s);
  void stop_all(double now_s);
  void publish(double now_s);

  const std::vector<Axis*> axes_;
  const SupervisorSettings settings_;
  MotionPermit* const permit_;
  LoopHeartbeat heartbeat_;
  std::atomic<double> alive_s_{0};
  std::atomic<Stop> stop_{Stop::kNone};

  // Of the loop.
  std::array<bool, kMaxAxes> was_in_error_{};
  StopCategory required_ = StopCategory::kNone;
  bool held_ = false;  ///< A hold-to-run jog is under way.
  MotionRequest present_;
  SupervisorStatus next_;

  mutable RealTimeMutex mutex_;  ///< Guards what follows; held for copies only.
  MotionRequest mailbox_;
  uint64_t requested_ = 0;
  bool reset_wanted_ = false;
  SupervisorStatus status_;
};

}  // namespace gantry
