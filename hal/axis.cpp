#include "gantry/hal/axis.h"

#include <cmath>
#include <cstdio>
#include <numbers>

namespace gantry {

std::string_view to_string(AxisState state) {
  switch (state) {
    case AxisState::kDisabled:
      return "Disabled";
    case AxisState::kStandstill:
      return "Standstill";
    case AxisState::kHoming:
      return "Homing";
    case AxisState::kDiscreteMotion:
      return "DiscreteMotion";
    case AxisState::kStopping:
      return "Stopping";
    case AxisState::kErrorStop:
      return "ErrorStop";
  }
  return "unknown";
}

namespace {

// Manuals list alarm codes in hexadecimal.
std::string alarm_text(int code) {
  char text[48];
  std::snprintf(text, sizeof text, "drive alarm %02Xh (%d)", static_cast<unsigned>(code), code);
  return text;
}

}  // namespace

Axis::Axis(std::unique_ptr<Drive> drive, AxisKind kind, AxisLimits limits, Clock& clock)
    : drive_(std::move(drive)), kind_(kind), limits_(limits), clock_(clock) {
  const auto require = [this](bool ok, const char* what) {
    if (!ok) throw InputError(drive_->info().text() + ": " + what);
  };
  require(limits_.lower < limits_.upper, "the lower soft limit must be below the upper one");
  require(limits_.speed > 0, "the speed must be positive");
  require(limits_.acceleration > 0, "the acceleration must be positive");
  require(limits_.in_position > 0, "the in-position band must be positive");
}

std::string Axis::format(double position) const {
  char text[48];
  const bool rotary = kind_ == AxisKind::kRotary;
  std::snprintf(text, sizeof text, "%.2f %s", rotary ? position * 180.0 / std::numbers::pi : position,
                rotary ? "deg" : "mm");
  return text;
}

Result<void> Axis::refuse(const std::string& command) const {
  std::string reason = command + " is not allowed in state " + std::string(to_string(status_.state));
  if (status_.state == AxisState::kErrorStop) reason += " (" + status_.error + "); reset first";
  return fault(FaultKind::kRefused, info().text(), reason);
}

tl::unexpected<Fault> Axis::enter_error(Fault fault) {
  if (status_.state != AxisState::kErrorStop) {
    status_.error = fault.message;
    // The drive may be the one that does not answer: then update() halts it as soon as it does.
    if (status_.state != AxisState::kDisabled) halt_owed_ = !drive_->halt();
    status_.state = AxisState::kErrorStop;
  }
  return tl::make_unexpected(std::move(fault));
}

void Axis::abort(const std::string& reason) {
  if (status_.state == AxisState::kErrorStop) return;
  (void)enter_error({FaultKind::kRefused, info().text(), reason});
}

Result<void> Axis::connect() {
  if (auto connected = drive_->connect(); !connected) return connected;
  auto reading = drive_->read_status();
  if (!reading) return tl::make_unexpected(reading.error());
  status_.drive = *reading;
  if (status_.state == AxisState::kDisabled) status_.target = reading->position;
  return {};
}

// Takes the servo command back, so that a drive that recovers later does not power the motor by itself.
tl::unexpected<Fault> Axis::give_up_enabling(Fault fault) {
  (void)drive_->set_servo(false);
  return enter_error(std::move(fault));
}

Result<void> Axis::enable() {
  if (status_.state != AxisState::kDisabled) return refuse("enable");
  if (auto done = drive_->set_servo(true); !done) return give_up_enabling(done.error());
  const double deadline_s = clock_.now_s() + 2.0;
  for (;;) {
    auto reading = drive_->read_status();
    if (!reading) return give_up_enabling(reading.error());
    status_.drive = *reading;
    if (reading->emergency_stop)
      return give_up_enabling({FaultKind::kRefused, info().text(), "the emergency stop is active"});
    if (reading->alarm)
      return give_up_enabling({FaultKind::kAlarm, info().text(), alarm_text(*reading->alarm)});
    if (reading->servo_on) break;
    if (clock_.now_s() > deadline_s)
      return give_up_enabling({FaultKind::kTimeout, info().text(), "the servo did not switch on within 2 s"});
    clock_.sleep_s(0.01);
  }
  status_.target = status_.drive.position;
  status_.state = AxisState::kStandstill;
  return {};
}

Result<void> Axis::disable() {
  if (status_.state != AxisState::kStandstill && status_.state != AxisState::kDisabled)
    return refuse("disable");
  if (auto done = drive_->set_servo(false); !done) return enter_error(done.error());
  status_.state = AxisState::kDisabled;
  return {};
}

Result<void> Axis::home() {
  if (status_.state != AxisState::kStandstill) return refuse("home");
  if (auto done = drive_->start_homing(); !done) return enter_error(done.error());
  status_.state = AxisState::kHoming;
  deadline_s_ = clock_.now_s() + limits_.homing_timeout_s;
  return {};
}

Result<void> Axis::move_to(double target) {
  if (status_.state != AxisState::kStandstill) return refuse("move");
  if (!status_.drive.homed)
    return fault(FaultKind::kRefused, info().text(), "move refused: the axis is not homed; home it first");
  if (!(target >= limits_.lower && target <= limits_.upper))
    return fault(FaultKind::kLimit, info().text(),
                 "move to " + format(target) + " refused: outside the soft limits " + format(limits_.lower) +
                     " to " + format(limits_.upper));
  if (auto done = drive_->start_move({target, limits_.speed, limits_.acceleration}); !done)
    return enter_error(done.error());
  const double distance = std::abs(target - status_.drive.position);
  deadline_s_ = clock_.now_s() + distance / limits_.speed + 2.0 * limits_.speed / limits_.acceleration +
                limits_.move_margin_s;
  status_.target = target;
  status_.state = AxisState::kDiscreteMotion;
  return {};
}

Result<void> Axis::stop() {
  if (status_.state == AxisState::kDisabled || status_.state == AxisState::kErrorStop) return refuse("stop");
  if (auto done = drive_->halt(); !done) return enter_error(done.error());
  status_.state = AxisState::kStopping;
  deadline_s_ = clock_.now_s() + 2.0 * limits_.speed / limits_.acceleration + limits_.move_margin_s;
  return {};
}

Result<void> Axis::reset() {
  if (status_.state != AxisState::kErrorStop) return refuse("reset");
  if (auto done = drive_->reset_alarm(); !done) return done;
  if (auto done = drive_->set_servo(false); !done) return done;
  halt_owed_ = false;
  status_.error.clear();
  status_.state = AxisState::kDisabled;
  return {};
}

Result<AxisStatus> Axis::update() {
  auto reading = drive_->read_status();
  if (!reading) return enter_error(reading.error());
  status_.drive = *reading;
  const bool powered = status_.state != AxisState::kDisabled && status_.state != AxisState::kErrorStop;
  if (powered) {
    if (reading->emergency_stop) {
      auto entered = enter_error({FaultKind::kRefused, info().text(), "the emergency stop became active"});
      // Releasing the button must not put the motor under power again.
      (void)drive_->set_servo(false);
      return entered;
    }
    if (reading->alarm) return enter_error({FaultKind::kAlarm, info().text(), alarm_text(*reading->alarm)});
    if (!reading->servo_on)
      return enter_error({FaultKind::kProtocol, info().text(), "the drive switched its servo off by itself"});
  }
  if (status_.state == AxisState::kErrorStop && halt_owed_) halt_owed_ = !drive_->halt();
  const bool late = clock_.now_s() > deadline_s_;
  switch (status_.state) {
    case AxisState::kHoming:
      if (reading->homed && !reading->moving) {
        status_.target = reading->position;
        status_.state = AxisState::kStandstill;
      } else if (late) {
        return enter_error({FaultKind::kTimeout, info().text(),
                            "homing did not end within " +
                                std::to_string(static_cast<int>(limits_.homing_timeout_s)) + " s"});
      }
      break;
    case AxisState::kDiscreteMotion:
      if (reading->in_position && !reading->moving &&
          std::abs(reading->position - status_.target) <= limits_.in_position) {
        status_.state = AxisState::kStandstill;
      } else if (late) {
        return enter_error({FaultKind::kNotSettled, info().text(),
                            "did not reach " + format(status_.target) + " in time; it stands at " +
                                format(reading->position)});
      }
      break;
    case AxisState::kStopping:
      if (!reading->moving) {
        status_.target = reading->position;
        status_.state = AxisState::kStandstill;
      } else if (late) {
        return enter_error(
            {FaultKind::kNotSettled, info().text(), "did not come to a standstill after stop"});
      }
      break;
    default:
      break;
  }
  return status_;
}

}  // namespace gantry
