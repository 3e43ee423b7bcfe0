#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "gantry/foundation/clock.h"
#include "gantry/hal/drive.h"

namespace gantry {

/// The states of PLCopen Motion Control part 1 that a positioning axis needs.
enum class AxisState {
  kDisabled,    ///< No power on the motor.
  kStandstill,  ///< Powered, holding its position.
  kHoming,
  kDiscreteMotion,  ///< Moving to a target.
  kStopping,
  kErrorStop  ///< An error was seen; only reset() leaves this state.
};

std::string_view to_string(AxisState state);

/// Fixed facts of an axis. Axis units: mm (linear) or rad (rotary).
struct AxisLimits {
  double lower = 0;  ///< Soft limits, valid after homing.
  double upper = 0;
  double speed = 0;  ///< Used for every move.
  double acceleration = 0;
  double in_position = 0;  ///< Band around the target that counts as arrived.
  double homing_timeout_s = 60;
  double move_margin_s = 5;  ///< A move may take its ideal time plus this.
};

struct AxisStatus {
  AxisState state = AxisState::kDisabled;
  DriveStatus drive;
  double target = 0;  ///< Of the last accepted move; the actual position after any enable.
  std::string error;  ///< Why the axis is in ErrorStop.
};

/// One motion axis: PLCopen's state machine, homing before motion, soft limits and time limits, on top
/// of any Drive. Commands start something and return; call update() often (every 10 to 50 ms) to let
/// the state follow the drive. Any fault of the drive leads to ErrorStop.
///
///   Disabled -enable-> Standstill -home-> Homing -> Standstill -move_to-> DiscreteMotion -> Standstill
///   any powered state -stop-> Stopping -> Standstill;  any -error-> ErrorStop -reset-> Disabled
class Axis {
 public:
  /// Throws InputError when the limits contradict each other.
  Axis(std::unique_ptr<Drive> drive, AxisKind kind, AxisLimits limits, Clock& clock);

  Result<void> connect();
  /// Allowed in Disabled. The target becomes the actual position: nothing moves.
  Result<void> enable();
  /// Allowed in Standstill and Disabled.
  Result<void> disable();
  /// Allowed in Standstill.
  Result<void> home();
  /// Allowed in Standstill when homed and the target lies within the soft limits.
  Result<void> move_to(double target);
  /// Allowed in every powered state; from any of them the axis decelerates to Standstill.
  Result<void> stop();
  /// Allowed in ErrorStop: clears the drive's alarm; the axis is Disabled afterwards.
  Result<void> reset();

  /// Reads the drive and follows it; returns the new status, or the fault that led to ErrorStop.
  Result<AxisStatus> update();

  /// Puts the axis into ErrorStop for a reason found outside (another axis failed): halts the drive.
  void abort(const std::string& reason);

  const AxisStatus& status() const { return status_; }
  const AxisLimits& limits() const { return limits_; }
  AxisKind kind() const { return kind_; }
  const DriveInfo& info() const { return drive_->info(); }
  const std::string& name() const { return drive_->info().axis; }
  /// "12.50 mm" or "-30.00 deg", for a person.
  std::string format(double position) const;

 private:
  Result<void> refuse(const std::string& command) const;
  tl::unexpected<Fault> enter_error(Fault fault);
  tl::unexpected<Fault> give_up_enabling(Fault fault);

  std::unique_ptr<Drive> drive_;
  AxisKind kind_;
  AxisLimits limits_;
  Clock& clock_;
  AxisStatus status_;
  double deadline_s_ = 0;
  bool halt_owed_ = false;  ///< The drive could not be told to halt when the error was seen.
};

}  // namespace gantry
