#include "modbus/kinds/numerical_move.h"

namespace gantry {

Result<DriveStatus> NumericalMoveDrive::read_status() {
  DriveStatus status;
  status.sampled_at_s = clock_.now_s();  // Before the exchange: never younger than it claims.
  const auto image = read_image();
  if (!image) return tl::make_unexpected(image.error());
  fill_common(status, *image);
  status.emergency_stop |= image->bit(profile_.find_bit("emergency_stop_input"));
  status.servo_on = image->bit(profile_.bit("servo_on"));
  status.homed = image->bit(profile_.bit("homed"));
  if (image->bit(profile_.bit("alarm"))) {
    const auto code = value(*image, profile_.reg("alarm_code"));
    if (!code) return tl::make_unexpected(code.error());
    status.alarm = static_cast<int>(*code);
  }

  const bool under_way = image->bit(profile_.bit("moving")) || image->bit(profile_.bit("homing"));
  const bool positioned = image->bit(profile_.bit("in_position"));
  const bool started = under_way || (target_counts_ ? !positioned : !status.homed);
  const bool awaiting_start = start_.pending(started, status.sampled_at_s);
  status.moving = under_way || (awaiting_start && status.servo_on);
  // The bit alone comes on before the motion has ended, and belongs to any move, not just to ours.
  status.in_position = positioned && !status.moving && at_target(*image);
  return status;
}

Result<void> NumericalMoveDrive::set_servo(bool on) {
  forget_motion();
  if (on && profile_.coils.contains("enable_commands")) {
    // Without it the drive takes its commands from its I/O plug and ignores the coils below.
    if (auto done = unit_.write_coil(profile_.coil("enable_commands"), true, kSetting); !done) return done;
  }
  return unit_.write_coil(profile_.coil("servo_on"), on, on ? kSetting : kStop);
}

// A paused drive keeps a command and runs it when somebody ends the pause: no motion by surprise.
Result<double> NumericalMoveDrive::position_unless_paused() const {
  const auto image = read_image();
  if (!image) return tl::make_unexpected(image.error());
  if (image->bit(profile_.find_bit("paused")))
    return unit_.refused("motion refused: the drive is paused (coil 040Ah); end the pause where it was set");
  return image->value(profile_.reg("position"));
}

Result<void> NumericalMoveDrive::start_homing() {
  if (auto position = position_unless_paused(); !position) return tl::make_unexpected(position.error());
  forget_motion();
  const uint16_t home = profile_.coil("home");
  if (auto done = unit_.write_coil(home, false); !done) return done;
  if (auto done = unit_.write_coil(home, true); !done) return done;
  start_.commanded(clock_.now_s());
  return {};
}

Result<void> NumericalMoveDrive::start_move(const MoveCommand& command) {
  const double target = to_counts(command.target);
  const auto speed = rate(command.speed / profile_.number("speed_unit_mm_s"), profile_.number("max_speed"));
  const auto acceleration = rate(command.acceleration / profile_.number("acceleration_unit_mm_s2"),
                                 profile_.number("max_acceleration"));
  if (!speed || !acceleration) return does_not_fit();
  const auto move = encode({{"target", target},
                            {"band", in_position_counts_},
                            {"speed", *speed},
                            {"acceleration", *acceleration},
                            {"push_current", 0},  // Not a push move.
                            {"flags", 0}});       // Absolute.
  if (!move) return tl::make_unexpected(move.error());

  const auto position = position_unless_paused();
  if (!position) return tl::make_unexpected(position.error());
  forget_motion();
  if (auto done = unit_.write(profile_.reg("target").address, *move); !done) return done;
  target_counts_ = target;
  // Where it already stands no motion will show.
  if (target != *position) start_.commanded(clock_.now_s());
  return {};
}

Result<void> NumericalMoveDrive::halt() {
  forget_motion();
  return unit_.write_coil(profile_.coil("stop"), true, kStop);
}

Result<void> NumericalMoveDrive::reset_alarm() {
  forget_motion();
  const uint16_t reset = profile_.coil("alarm_reset");
  if (auto done = unit_.write_coil(reset, false); !done) return done;
  if (auto done = unit_.write_coil(reset, true); !done) return done;
  return unit_.write_coil(reset, false);
}

}  // namespace gantry
