#pragma once

#include <memory>
#include <string>

#include "gantry/foundation/clock.h"
#include "gantry/hal/axis_machine.h"
#include "gantry/hal/drive.h"

namespace gantry {

/// An axis as people and records see it.
struct AxisStatus {
  AxisState state = AxisState::kDisabled;
  DriveStatus drive;
  double target = 0;  ///< Of the last accepted move; the actual position after any enable.
  std::string error;  ///< Why the axis is in ErrorStop.
};

/// One drive with its channel and its state machine, and the words for them. Under a Supervisor
/// (acquisition/supervisor.h) only channel(), machine() and the fixed facts are used; the calls below
/// service the channel in place, for one axis alone: commissioning and the conformance tests of drives.
/// They start something and return; call update() often (every 10 to 50 ms).
class Axis {
 public:
  /// Throws InputError when the limits contradict each other.
  Axis(std::unique_ptr<Drive> drive, AxisKind kind, AxisLimits limits, Clock& clock);

  Result<void> connect();
  /// Returns when the drive has confirmed, or failed to. Nothing moves.
  Result<void> enable();
  Result<void> disable();
  Result<void> home();
  Result<void> move_to(double target);
  Result<void> stop();
  /// Returns when the drive has confirmed: the axis is Disabled then.
  Result<void> reset();
  /// Reads the drive and follows it; returns the new status, or the fault that led to ErrorStop.
  Result<AxisStatus> update();
  /// Puts a powered axis into ErrorStop and halts its drive.
  void abort();

  AxisStatus status() const;
  /// The error of ErrorStop as a fault, with the drive's own words where it gave any.
  Fault fault_of(const AxisError& error) const;
  /// Why a command was not taken: "refused: tilt is not homed; ...".
  Fault refusal(AxisRefusal refusal, AxisTrigger command, double target, AxisState state,
                const AxisError& error) const;

  DriveChannel& channel() { return channel_; }
  AxisMachine& machine() { return machine_; }
  const AxisLimits& limits() const { return machine_.limits(); }
  AxisKind kind() const { return machine_.kind(); }
  const DriveInfo& info() const { return drive_->info(); }
  const std::string& name() const { return drive_->info().axis; }
  /// "12.50 mm" or "-30.00 deg", for a person.
  std::string format(double position) const { return format_position(kind(), position); }

 private:
  Result<void> started(AxisRefusal refusal, AxisTrigger command, double target = 0);
  Result<void> wait_while_pending();
  void follow();

  std::unique_ptr<Drive> drive_;
  Clock& clock_;
  DriveChannel channel_;
  AxisMachine machine_;
};

}  // namespace gantry
