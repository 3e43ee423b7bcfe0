#pragma once

#include <memory>
#include <optional>

#include "gantry/foundation/clock.h"
#include "gantry/hal/drive.h"
#include "gantry/sim/stage.h"
#include "gantry/sim/twin/wire_faults.h"

namespace gantry {

/// The wire that drives in this process share, and what is wrong with it.
struct FaultyBus {
  explicit FaultyBus(uint64_t seed) : wire(seed) {}
  WireFaults wire;
  bool connected = true;
};

/// A drive in this process behind a wire that can fail and with electronics that can. What a bad wire
/// comes to is told at the level of Drive: a lost request has no effect, a lost or late reply had one, a
/// broken reply is a protocol fault; readings are repeated as a bus does. The bytes themselves fail in the
/// twin only. Not thread-safe.
class FaultyDrive final : public Drive {
 public:
  /// How often a bus asks for a reading before it gives up.
  static constexpr int kReadAttempts = 3;
  /// A later reply is no reply.
  static constexpr double kResponseTimeout_s = 0.2;

  /// `stage`: the one that `inner` moves. It and the bus outlive the drive.
  FaultyDrive(std::unique_ptr<Drive> inner, SimulatedStage& stage, FaultyBus& bus, int unit, Clock& clock);

  void set_silent(bool silent) { silent_ = silent; }
  /// Torque off, and an alarm that a reset clears once the cause is gone.
  void raise_alarm(int code);
  void clear_alarm_cause() { alarm_cause_ = false; }
  void set_emergency_stop(bool active);
  void set_supply(bool on);
  /// Whether commands get through for certain.
  bool reachable() const { return !silent_ && supply_ && bus_.connected; }

  const DriveInfo& info() const override { return inner_->info(); }
  Result<void> connect() override;
  Result<DriveStatus> read_status() override;
  Result<void> set_servo(bool on) override;
  Result<void> start_homing() override;
  Result<void> start_move(const MoveCommand& command) override;
  Result<void> halt() override;
  Result<void> reset_alarm() override;
  Result<void> set_communication_timeout(double timeout_s) override;
  bool moves_unhomed() const override { return inner_->moves_unhomed(); }

 private:
  template <typename Act>
  auto exchange(const Act& act) -> decltype(act());

  std::unique_ptr<Drive> inner_;
  SimulatedStage& stage_;
  FaultyBus& bus_;
  const int unit_;
  Clock& clock_;
  bool silent_ = false, supply_ = true, emergency_stop_ = false, alarm_cause_ = false;
  std::optional<int> alarm_;
};

}  // namespace gantry
