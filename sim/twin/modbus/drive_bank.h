#pragma once

#include <poll.h>

#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/foundation/error.h"
#include "gantry/sim/twin/wire_faults.h"
#include "modbus_gateway.h"

namespace gantry {

/// The drives of one endpoint and the faults of its wire. Thread-safe.
class DriveBank {
 public:
  explicit DriveBank(Clock& clock) : clock_(clock) {}

  /// Throws InputError for a unit that is taken or out of range.
  void add(int unit, std::unique_ptr<TwinDrive> drive);
  double now_s() const { return clock_.now_s(); }

  /// Calls `action(drive, now_s)`; for the fault injection. Throws InputError for a unit that was not added.
  template <typename Action>
  void with_drive(int unit, Action action) {
    std::lock_guard lock(mutex_);
    const auto drive = drives_.find(unit);
    if (drive == drives_.end()) throw InputError("Modbus twin: no drive has unit " + std::to_string(unit));
    action(*drive->second, clock_.now_s());
  }

  struct Reply {
    std::vector<uint8_t> pdu;
    std::optional<WireFault> fault;
  };
  /// Lets the addressed drive act. Nothing is answered to a request that it never hears. An absent unit:
  /// exception 0B where a gateway stands for it, silence on a line of its own.
  std::optional<Reply> answer(int unit, std::span<const uint8_t> pdu, bool gateway);

  WireFaults& faults() { return faults_; }

 private:
  Clock& clock_;
  std::mutex mutex_;
  TwinDrives drives_;
  WireFaults faults_;
};

/// Replies on their way: when each is due, in real time. The replies of one unit keep their order, because a
/// drive answers one request after another.
class ReplyQueue {
 public:
  struct Waiting {
    double due_s;
    int unit;
    int client;  ///< Which connection it belongs to.
    std::vector<uint8_t> frame;
  };

  /// `frame` is the whole reply; damage is done here. `corruptible` is how many of its bytes a wrong bit may
  /// hit.
  void push(DriveBank& bank, const DriveBank::Reply& reply, int unit, int client, std::vector<uint8_t> frame,
            size_t corruptible, double due_s);
  /// The next one that is due, if any.
  std::optional<Waiting> pop(double now_s);
  /// poll(2) until the next one is due, to the microsecond.
  int poll(std::span<pollfd> polled, double now_s) const;
  void clear() { waiting_.clear(); }

 private:
  std::vector<Waiting> waiting_;  ///< By due time.
};

}  // namespace gantry
