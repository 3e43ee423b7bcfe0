#include "gantry/hal/axis_machine.h"

#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

constexpr double kServoOnWithin_s = 2.0;
constexpr double kResetWithin_s = 1.0;
/// A drive that neither homes nor moves for so long has given up homing.
constexpr double kHomingGivenUp_s = 0.5;
/// A halted axis that still moves this long after its braking time loses its torque.
constexpr double kHaltMargin_s = 0.3;
/// An axis at standstill may be pushed so many bands off its target.
constexpr double kDriftBands = 10;

bool positive(double value) {
  return value > 0 && std::isfinite(value);
}

}  // namespace

void require_sound(const AxisLimits& limits, const std::string& who) {
  const auto require = [&who](bool ok, const char* what) {
    if (!ok) throw InputError(who + ": " + what);
  };
  require(limits.lower < limits.upper, "the lower soft limit must be below the upper one");
  require(positive(limits.speed), "the speed must be positive");
  require(positive(limits.acceleration), "the acceleration must be positive");
  require(positive(limits.in_position), "the in-position band must be positive");
  require(positive(limits.homing_timeout_s), "the homing time limit must be positive");
  require(positive(limits.data_limit_s), "the age limit of readings must be positive");
  require(limits.move_margin_s >= 0, "the time margin of moves must not be negative");
  require(limits.jog_speed >= 0 && limits.jog_speed <= limits.speed,
          "the jog speed must lie between 0 and the speed");
  require(limits.unhomed_jog_speed >= 0 && limits.unhomed_jog_speed <= limits.speed,
          "the jog speed before homing must lie between 0 and the speed");
  require(limits.following_error >= 0 && limits.following_error_at_rest >= 0 &&
              limits.following_error_time_s >= 0,
          "following error and its time must not be negative");
  require(limits.following_error_at_rest <= limits.following_error || limits.following_error == 0,
          "the following error allowed at rest must not exceed the one allowed at full speed");
  require(std::isfinite(limits.position_at_home), "the homing offset must be a number");
}

AxisMachine::AxisMachine(AxisKind kind, const AxisLimits& limits, DriveChannel& channel)
    : kind_(kind), limits_(limits), channel_(channel) {}

bool AxisMachine::follow(AxisTrigger trigger) {
  const auto next = next_state(state_, trigger);
  if (next) state_ = *next;
  return next.has_value();
}

bool AxisMachine::post(DriveAction action, double now_s, const MoveCommand& move) {
  if (!channel_.post({action, move})) {
    fail({AxisReason::kQueueFull}, Torque::kKeep, now_s);
    return false;
  }
  ticket_ = channel_.posted();
  return true;
}

// ---- Commands ---------------------------------------------------------------------------------

AxisRefusal AxisMachine::check(AxisTrigger command) const {
  const bool busy =
      (command == AxisTrigger::kEnable && enabling()) || (command == AxisTrigger::kReset && resetting());
  return next_state(state_, command) && !busy ? AxisRefusal::kNone : AxisRefusal::kWrongState;
}

AxisRefusal AxisMachine::enable(double now_s) {
  if (const auto refusal = check(AxisTrigger::kEnable); refusal != AxisRefusal::kNone) return refusal;
  // A drive that kept the rest of a travel must forget it before it gets power.
  post(DriveAction::kHalt, now_s);
  if (!post(DriveAction::kServoOn, now_s)) return AxisRefusal::kQueueFull;
  pending_ = Pending::kEnable;
  deadline_s_ = now_s + kServoOnWithin_s;
  return AxisRefusal::kNone;
}

AxisRefusal AxisMachine::disable(double now_s) {
  if (const auto refusal = check(AxisTrigger::kDisable); refusal != AxisRefusal::kNone) return refusal;
  pending_ = Pending::kNone;
  post(DriveAction::kServoOff, now_s);
  follow(AxisTrigger::kDisable);
  return AxisRefusal::kNone;
}

AxisRefusal AxisMachine::home(double now_s) {
  if (const auto refusal = check(AxisTrigger::kHome); refusal != AxisRefusal::kNone) return refusal;
  if (!post(DriveAction::kHome, now_s)) return AxisRefusal::kQueueFull;
  unhomed_rest_since_s_.reset();
  deadline_s_ = now_s + limits_.homing_timeout_s;
  follow(AxisTrigger::kHome);
  return AxisRefusal::kNone;
}

AxisRefusal AxisMachine::check_move(const MoveCommand& command) const {
  if (const auto refusal = check(AxisTrigger::kMove); refusal != AxisRefusal::kNone) return refusal;
  if (!snapshot_.status.homed) return AxisRefusal::kNotHomed;
  return check_jog(command);
}

AxisRefusal AxisMachine::check_jog(const MoveCommand& command) const {
  if (const auto refusal = check(AxisTrigger::kJog); refusal != AxisRefusal::kNone) return refusal;
  if (snapshot_.status.homed && !(command.target >= limits_.lower && command.target <= limits_.upper))
    return AxisRefusal::kSoftLimit;
  if (!std::isfinite(command.target) || !positive(command.speed) || !positive(command.acceleration))
    return AxisRefusal::kNotANumber;
  if (!snapshot_.status.homed && !channel_.drive().moves_unhomed()) return AxisRefusal::kCannotMoveUnhomed;
  const double way = command.target - snapshot_.status.position;
  if ((snapshot_.status.lower_limit && way < 0) || (snapshot_.status.upper_limit && way > 0))
    return AxisRefusal::kOnLimitSwitch;
  return AxisRefusal::kNone;
}

AxisRefusal AxisMachine::move(const MoveCommand& command, double now_s) {
  if (const auto refusal = check_move(command); refusal != AxisRefusal::kNone) return refusal;
  return jog(command, now_s);
}

AxisRefusal AxisMachine::jog(const MoveCommand& command, double now_s) {
  if (const auto refusal = check_jog(command); refusal != AxisRefusal::kNone) return refusal;
  const double here = snapshot_.status.position;
  MoveCommand move = command;
  move.speed = std::min(move.speed, snapshot_.status.homed ? limits_.speed : limits_.unhomed_jogging_speed());
  move.acceleration = std::min(move.acceleration, limits_.acceleration);
  if (!post(DriveAction::kMove, now_s, move)) return AxisRefusal::kQueueFull;
  target_ = move.target;
  // Homing may end outside the soft limits: from there only inward.
  const double margin = 3 * limits_.in_position;
  allowed_lower_ = std::min(limits_.lower, here) - margin;
  allowed_upper_ = std::max(limits_.upper, here) + margin;
  deadline_s_ = now_s + std::abs(move.target - here) / move.speed + 2.0 * move.speed / move.acceleration +
                limits_.move_margin_s;
  follow(AxisTrigger::kMove);
  return AxisRefusal::kNone;
}

AxisRefusal AxisMachine::stop(double now_s) {
  if (const auto refusal = check(AxisTrigger::kStop); refusal != AxisRefusal::kNone) return refusal;
  post(DriveAction::kHalt, now_s);
  deadline_s_ = now_s + 2.0 * limits_.braking_s() + limits_.move_margin_s;
  follow(AxisTrigger::kStop);
  return AxisRefusal::kNone;
}

AxisRefusal AxisMachine::reset(double now_s) {
  if (const auto refusal = check(AxisTrigger::kReset); refusal != AxisRefusal::kNone) return refusal;
  // Without power, so that a drive that powers its motor with the reset does not.
  post(DriveAction::kServoOff, now_s);
  if (!post(DriveAction::kResetAlarm, now_s)) return AxisRefusal::kQueueFull;
  torque_off_at_rest_by_s_.reset();
  torque_off_if_moving_at_s_.reset();
  pending_ = Pending::kReset;
  deadline_s_ = now_s + kResetWithin_s;
  return AxisRefusal::kNone;
}

// ---- Errors -----------------------------------------------------------------------------------

void AxisMachine::fail(const AxisError& error, Torque torque, double now_s) {
  const bool was_powered = is_powered(state_);
  const bool was_enabling = pending_ == Pending::kEnable;
  if (state_ != AxisState::kErrorStop || error_.reason == AxisReason::kNone || (pending_ == Pending::kReset))
    error_ = error;
  pending_ = Pending::kNone;
  follow(AxisTrigger::kFault);
  // A servo command that is under way is taken back, so that a drive that recovers later does not power
  // the motor by itself.
  if (torque == Torque::kOffAtOnce || was_enabling) {
    post(DriveAction::kServoOff, now_s);
    post(DriveAction::kHalt, now_s);  // Nor is anything of the travel left for later.
  } else if (was_powered) {
    post(DriveAction::kHalt, now_s);
    torque_off_if_moving_at_s_ = now_s + limits_.braking_s() + kHaltMargin_s;
  }
  if (torque == Torque::kOffAtRest) torque_off_at_rest_by_s_ = now_s + limits_.braking_s() + kHaltMargin_s;
}

void AxisMachine::abort(const AxisError& error, Torque torque, double now_s) {
  if (state_ == AxisState::kDisabled && pending_ == Pending::kNone) {
    // Powered by somebody else: a program that ended before, a person at the drive.
    if (torque != Torque::kKeep && snapshot_.status.servo_on) post(DriveAction::kServoOff, now_s);
    return;
  }
  if (state_ != AxisState::kErrorStop) return fail(error, torque, now_s);
  if (!snapshot_.status.servo_on) return;
  if (torque == Torque::kOffAtOnce) post(DriveAction::kServoOff, now_s);
  if (torque == Torque::kOffAtRest && !torque_off_at_rest_by_s_)
    torque_off_at_rest_by_s_ = now_s + limits_.braking_s() + kHaltMargin_s;
}

void AxisMachine::follow_up_error(double now_s) {
  const bool moving = snapshot_.status.moving || std::abs(velocity_) > 0.02 * limits_.speed;
  const bool at_rest = fresh() && !moving;
  if (torque_off_at_rest_by_s_ && (at_rest || now_s > *torque_off_at_rest_by_s_)) {
    torque_off_at_rest_by_s_.reset();
    post(DriveAction::kServoOff, now_s);
  }
  // It has begun to move again, held as it was.
  if (!at_rest && snapshot_.status.servo_on && fresh() && !torque_off_if_moving_at_s_)
    torque_off_if_moving_at_s_ = now_s + kHaltMargin_s;
  // Halting did not help: a runaway, or a drive that does not obey.
  if (torque_off_if_moving_at_s_ && now_s > *torque_off_if_moving_at_s_) {
    torque_off_if_moving_at_s_.reset();
    if (!at_rest) post(DriveAction::kServoOff, now_s);
  }
  if (pending_ != Pending::kReset) return;
  const DriveStatus& drive = snapshot_.status;
  if (fresh() && !drive.alarm && !drive.emergency_stop && !drive.servo_on) {
    pending_ = Pending::kNone;
    error_ = {};
    target_ = drive.position;
    follow(AxisTrigger::kCleared);
  } else if (now_s > deadline_s_) {
    pending_ = Pending::kNone;
    error_ = drive.emergency_stop ? AxisError{AxisReason::kEmergencyStop}
                                  : AxisError{AxisReason::kResetFailed, drive.alarm.value_or(0)};
  }
}

double AxisMachine::allowed_following_error() const {
  const double share = std::min(1.0, std::abs(velocity_) / limits_.speed);
  return limits_.following_error_at_rest +
         share * (limits_.following_error - limits_.following_error_at_rest);
}

// What can go wrong while the motor holds or moves the axis.
AxisError AxisMachine::motion_fault() {
  const DriveStatus& drive = snapshot_.status;
  if (drive.emergency_stop) return {AxisReason::kEmergencyStop};
  if (drive.alarm) return {AxisReason::kAlarm, *drive.alarm};
  if (!drive.servo_on) return {AxisReason::kServoLost};

  const bool lower = drive.lower_limit && !lower_limit_, upper = drive.upper_limit && !upper_limit_;
  lower_limit_ = drive.lower_limit;
  upper_limit_ = drive.upper_limit;
  // Homing may look for its switch by way of a limit switch; the drive knows.
  if ((lower || upper) && state_ != AxisState::kHoming) return {AxisReason::kLimitSwitch, lower ? -1 : 1};

  if (limits_.following_error > 0 && drive.following_error) {
    const double allowed = allowed_following_error();
    if (std::abs(*drive.following_error) <= allowed) {
      excess_since_s_.reset();
    } else if (!excess_since_s_) {
      excess_since_s_ = drive.sampled_at_s;
    } else if (drive.sampled_at_s - *excess_since_s_ >= limits_.following_error_time_s) {
      return {AxisReason::kFollowingError, 0, *drive.following_error, allowed};
    }
  }
  if (state_ == AxisState::kDiscreteMotion && drive.homed) {
    if (drive.position < allowed_lower_) return {AxisReason::kSoftLimit, 0, drive.position, limits_.lower};
    if (drive.position > allowed_upper_) return {AxisReason::kSoftLimit, 0, drive.position, limits_.upper};
  }
  if (state_ == AxisState::kStandstill && fresh() &&
      std::abs(drive.position - target_) > kDriftBands * limits_.in_position)
    return {AxisReason::kDrift, 0, drive.position, target_};
  return {};
}

AxisError AxisMachine::fault_in(double now_s) {
  const bool new_fault = snapshot_.faults != seen_faults_;
  seen_faults_ = snapshot_.faults;
  const bool new_stall = snapshot_.stalls != seen_stalls_;
  seen_stalls_ = snapshot_.stalls;
  if (new_fault) return {AxisReason::kDriveFault, static_cast<int>(snapshot_.last_fault)};
  if (!snapshot_.read || state_ == AxisState::kErrorStop) return {};
  if (state_ == AxisState::kDisabled && pending_ == Pending::kNone) {
    const auto& alarm = snapshot_.status.alarm;
    return alarm && fresh() ? AxisError{AxisReason::kAlarm, *alarm} : AxisError{};
  }
  if (new_stall) return {AxisReason::kLoopStalled};
  if (const double age_s = snapshot_.age_s(now_s); age_s > limits_.data_limit_s)
    return {AxisReason::kStaleData, 0, age_s, limits_.data_limit_s};
  return pending_ == Pending::kEnable ? AxisError{} : motion_fault();
}

// ---- Following the drive ----------------------------------------------------------------------

void AxisMachine::take_reading(const DriveSnapshot& snapshot) {
  const double elapsed_s = snapshot.status.sampled_at_s - snapshot_.status.sampled_at_s;
  if (snapshot_.read && elapsed_s > 1e-6) {
    // Homing gives the coordinates a new origin: that is no motion.
    const bool same_origin = snapshot.status.homed == snapshot_.status.homed;
    velocity_ = same_origin ? (snapshot.status.position - snapshot_.status.position) / elapsed_s : 0;
  }
  snapshot_ = snapshot;
}

void AxisMachine::step(const DriveSnapshot& snapshot, double now_s) {
  take_reading(snapshot);
  if (const AxisError error = fault_in(now_s); error.reason != AxisReason::kNone) {
    // Releasing the button must not put the motor under power again.
    const bool unpower = error.reason == AxisReason::kEmergencyStop;
    if (state_ != AxisState::kErrorStop || pending_ == Pending::kReset)
      fail(error, unpower ? Torque::kOffAtOnce : Torque::kKeep, now_s);
  }
  if (state_ == AxisState::kErrorStop) return follow_up_error(now_s);
  advance(now_s);
}

void AxisMachine::advance(double now_s) {
  const DriveStatus& drive = snapshot_.status;
  const bool late = now_s > deadline_s_;
  switch (state_) {
    case AxisState::kDisabled:
      if (pending_ == Pending::kNone) {
        if (snapshot_.read) target_ = drive.position;
      } else if (fresh() && drive.emergency_stop) {
        fail({AxisReason::kEmergencyStop}, Torque::kOffAtOnce, now_s);
      } else if (fresh() && drive.alarm) {
        fail({AxisReason::kAlarm, *drive.alarm}, Torque::kOffAtOnce, now_s);
      } else if (fresh() && drive.servo_on) {
        pending_ = Pending::kNone;
        target_ = drive.position;
        lower_limit_ = drive.lower_limit;
        upper_limit_ = drive.upper_limit;
        excess_since_s_.reset();
        follow(AxisTrigger::kPowered);
      } else if (late) {
        fail({AxisReason::kServoDidNotComeOn, 0, 0, kServoOnWithin_s}, Torque::kOffAtOnce, now_s);
      }
      break;
    case AxisState::kHoming:
      if (fresh() && drive.homed && !drive.moving) {
        target_ = drive.position;
        follow(AxisTrigger::kDone);
        break;
      }
      if (!fresh() || drive.homed || drive.moving) {
        unhomed_rest_since_s_.reset();
      } else if (!unhomed_rest_since_s_) {
        unhomed_rest_since_s_ = drive.sampled_at_s;
      } else if (drive.sampled_at_s - *unhomed_rest_since_s_ > kHomingGivenUp_s) {
        fail({AxisReason::kHomingFailed}, Torque::kKeep, now_s);
        break;
      }
      if (late) fail({AxisReason::kHomingTimeout, 0, 0, limits_.homing_timeout_s}, Torque::kKeep, now_s);
      break;
    case AxisState::kDiscreteMotion:
      if (fresh() && drive.in_position && !drive.moving &&
          std::abs(drive.position - target_) <= limits_.in_position)
        follow(AxisTrigger::kDone);
      else if (late)
        fail({AxisReason::kNotArrived, 0, drive.position, target_}, Torque::kKeep, now_s);
      break;
    case AxisState::kStopping:
      if (fresh() && !drive.moving) {
        target_ = drive.position;
        follow(AxisTrigger::kDone);
      } else if (late) {
        fail({AxisReason::kNotStopped}, Torque::kKeep, now_s);
      }
      break;
    default:
      break;
  }
}

}  // namespace gantry
