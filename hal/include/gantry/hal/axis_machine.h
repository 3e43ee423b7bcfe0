#pragma once

#include <optional>

#include "gantry/hal/axis_error.h"
#include "gantry/hal/axis_states.h"
#include "gantry/hal/drive_channel.h"

namespace gantry {

/// Fixed facts of an axis. Axis units: mm (linear) or rad (rotary).
struct AxisLimits {
  double lower = 0;  ///< Soft limits, valid after homing.
  double upper = 0;
  double speed = 0;         ///< Highest speed of any move.
  double acceleration = 0;  ///< Highest acceleration of any move.
  double in_position = 0;   ///< Band around the target that counts as arrived.
  double homing_timeout_s = 60;
  double move_margin_s = 5;      ///< A move may take its ideal time plus this.
  double jog_speed = 0;          ///< 0: a fifth of the speed.
  double unhomed_jog_speed = 0;  ///< 0: a fiftieth of the speed. Nothing is known of the limits then.
  double position_at_home = 0;   ///< Where the axis is when the drive reads zero.
  /// Following error that is allowed at full speed, and at rest; linear in between. 0: not watched.
  double following_error = 0;
  double following_error_at_rest = 0;
  double following_error_time_s = 0.1;  ///< Only an excess that lasts longer counts.
  double data_limit_s = 0.5;            ///< A powered axis is stopped when its newest reading is older.

  double jogging_speed() const { return jog_speed > 0 ? jog_speed : speed / 5; }
  double unhomed_jogging_speed() const { return unhomed_jog_speed > 0 ? unhomed_jog_speed : speed / 50; }
  double braking_s() const { return speed / acceleration; }
  double braking_distance() const { return 0.5 * speed * speed / acceleration; }
};

/// Throws InputError beginning with `who` when the limits contradict each other.
void require_sound(const AxisLimits& limits, const std::string& who);

/// PLCopen's state machine of one axis (axis_states.h), with homing before motion, soft limits, time
/// limits and watchdogs: the one implementation for all drives. Pure: it sees snapshots, posts commands to
/// a channel, and neither waits, nor allocates, nor asks for the time.
///
/// Of every enable the target is the actual position, and every start and halt of a drive is commanded
/// anew: what a drive kept from before never runs.
class AxisMachine {
 public:
  AxisMachine(AxisKind kind, const AxisLimits& limits, DriveChannel& channel);

  // Commands. kNone: taken. Any other answer: nothing was done.
  AxisRefusal enable(double now_s);
  AxisRefusal disable(double now_s);
  AxisRefusal home(double now_s);
  AxisRefusal move(const MoveCommand& command, double now_s);
  /// As move(); before homing at jog speed at most, in the encoder's coordinates, without soft limits.
  AxisRefusal jog(const MoveCommand& command, double now_s);
  AxisRefusal stop(double now_s);
  AxisRefusal reset(double now_s);
  /// What the command would answer now.
  AxisRefusal check_move(const MoveCommand& command) const;
  AxisRefusal check_jog(const MoveCommand& command) const;
  AxisRefusal check(AxisTrigger command) const;

  enum class Torque : uint8_t { kKeep, kOffAtOnce, kOffAtRest };
  /// Into ErrorStop for a reason found outside; a powered axis is halted. A disabled axis stays as it is.
  /// In ErrorStop already, only a torque that is to go off sooner is heeded.
  void abort(const AxisError& error, Torque torque, double now_s);

  /// Follows the drive. Call it once a cycle.
  void step(const DriveSnapshot& snapshot, double now_s);

  AxisState state() const { return state_; }
  const AxisError& error() const { return error_; }
  const DriveSnapshot& snapshot() const { return snapshot_; }
  double target() const { return target_; }
  bool enabling() const { return pending_ == Pending::kEnable; }
  bool resetting() const { return pending_ == Pending::kReset; }
  const AxisLimits& limits() const { return limits_; }
  AxisKind kind() const { return kind_; }

 private:
  enum class Pending : uint8_t { kNone, kEnable, kReset };

  bool follow(AxisTrigger trigger);  ///< False when the table has no such line.
  bool post(DriveAction action, double now_s, const MoveCommand& move = {});
  void fail(const AxisError& error, Torque torque, double now_s);
  void take_reading(const DriveSnapshot& snapshot);
  AxisError fault_in(double now_s);
  AxisError motion_fault();
  void advance(double now_s);
  void follow_up_error(double now_s);
  double allowed_following_error() const;
  bool fresh() const { return snapshot_.executed >= ticket_; }

  const AxisKind kind_;
  const AxisLimits limits_;
  DriveChannel& channel_;
  AxisState state_ = AxisState::kDisabled;
  Pending pending_ = Pending::kNone;
  AxisError error_;
  DriveSnapshot snapshot_;
  uint64_t ticket_ = 0;  ///< The last command; older readings do not know of it.
  uint64_t seen_faults_ = 0, seen_stalls_ = 0;
  double target_ = 0;
  double allowed_lower_ = 0, allowed_upper_ = 0;  ///< Of the present motion, once homed.
  double deadline_s_ = 0;
  double velocity_ = 0;  ///< From two readings.
  std::optional<double> excess_since_s_, unhomed_rest_since_s_;
  bool lower_limit_ = false, upper_limit_ = false;  ///< As known; a new one is a fault.
  std::optional<double> torque_off_at_rest_by_s_;   ///< Off at rest, and by then in any case.
  std::optional<double> torque_off_if_moving_at_s_;
};

}  // namespace gantry
