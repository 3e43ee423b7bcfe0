#include "modbus/kinds/pr_path.h"

#include <cmath>
#include <cstdio>

namespace gantry {
namespace {

constexpr double kAbsolutePositioning = 1;

}  // namespace

PrPathDrive::PrPathDrive(DriveProfile profile, ModbusUnit unit, const Options& options,
                         double counts_per_motor_revolution, Clock& clock)
    : RegisterDrive(std::move(profile), std::move(unit), options, clock),
      counts_per_motor_revolution_(counts_per_motor_revolution) {}

double PrPathDrive::rpm(double axis_units_per_s) const {
  return axis_units_per_s * counts_per_axis_unit_ / counts_per_motor_revolution_ * 60;
}

Result<void> PrPathDrive::connect() {
  if (auto connected = RegisterDrive::connect(); !connected) return connected;
  const auto word = profile_.find_register("pulses_per_revolution");
  if (!word) return {};
  const auto words = unit_.read(word->address, static_cast<uint16_t>(words_of(word->type)));
  if (!words) return tl::make_unexpected(words.error());
  const double pulses = value_from_words(*words, word->type, profile_.word_order);
  if (pulses == counts_per_motor_revolution_) return {};
  char text[160];
  std::snprintf(text, sizeof text,
                "the drive is set to %.0f pulses per motor revolution, but %.0f are configured "
                "(steps_per_motor_revolution)",
                pulses, counts_per_motor_revolution_);
  return unit_.refused(text);
}

Result<DriveStatus> PrPathDrive::read_status() {
  DriveStatus status;
  status.sampled_at_s = clock_.now_s();  // Before the exchanges: never younger than it claims.
  // The profile reads the status word before the position, as for every drive.
  const auto image = read_image();
  if (!image) return tl::make_unexpected(image.error());
  fill_common(status, *image);
  status.servo_on = image->bit(profile_.bit("enabled"));
  status.homed = image->bit(profile_.bit("homed"));
  if (image->bit(profile_.bit("fault"))) {
    const auto code = value(*image, profile_.reg("alarm_code"));
    if (!code) return tl::make_unexpected(code.error());
    status.alarm = static_cast<int>(*code);
  }

  const bool under_way = image->bit(profile_.bit("running"));
  const bool path_done = image->bit(profile_.bit("path_done"));
  const bool arrived = path_done && at_target(*image);
  const bool started = under_way || (target_counts_ ? !path_done || arrived : !status.homed);
  const bool awaiting_start = start_.pending(started, status.sampled_at_s);
  status.moving = under_way || (awaiting_start && status.servo_on);
  status.in_position = arrived && !status.moving;
  return status;
}

Result<void> PrPathDrive::set_servo(bool on) {
  forget_motion();
  return write(profile_.reg("enable"), on ? 1 : 0, on ? kSetting : kStop);
}

// The drive acknowledges a start that it cannot run, and says no more about it.
Result<void> PrPathDrive::require_enabled(const char* command) const {
  const auto image = read_image();
  if (!image) return tl::make_unexpected(image.error());
  if (image->bit(profile_.bit("fault")))
    return unit_.refused(std::string(command) + " refused: the drive has an alarm");
  if (!image->bit(profile_.bit("enabled")))
    return unit_.refused(std::string(command) + " refused: the drive is not enabled");
  return {};
}

Result<void> PrPathDrive::start_homing() {
  forget_motion();
  if (auto enabled = require_enabled("homing"); !enabled) return enabled;
  if (auto done = write(profile_.reg("trigger"), profile_.number("home_trigger")); !done) return done;
  start_.commanded(clock_.now_s());
  return {};
}

Result<void> PrPathDrive::start_move(const MoveCommand& command) {
  const double target = to_counts(command.target);
  const auto speed = rate(rpm(command.speed), profile_.number("max_speed_rpm"));
  // Rounded up: gentler than asked for, never harsher.
  const double ramp_ms = std::ceil(1e6 / rpm(command.acceleration));
  const auto ramp = command.acceleration > 0 ? rate(ramp_ms, profile_.number("max_ramp_ms")) : std::nullopt;
  if (!speed || !ramp) return does_not_fit();
  const auto path = encode({{"path_mode", kAbsolutePositioning},
                            {"path_position", target},
                            {"path_speed", *speed},
                            {"path_acceleration", *ramp},
                            {"path_deceleration", *ramp},
                            {"path_delay", 0},
                            {"path_trigger", profile_.number("run_trigger")}});
  if (!path) return tl::make_unexpected(path.error());
  if (auto enabled = require_enabled("move"); !enabled) return enabled;

  forget_motion();
  if (auto done = unit_.write(profile_.reg("path_mode").address, *path); !done) return done;
  target_counts_ = target;
  start_.commanded(clock_.now_s());
  return {};
}

Result<void> PrPathDrive::halt() {
  forget_motion();
  return write(profile_.reg("trigger"), profile_.number("stop_trigger"), kStop);
}

// Without power, because the forced enable outlives the alarm and would put the motor under power.
Result<void> PrPathDrive::reset_alarm() {
  forget_motion();
  if (auto done = write(profile_.reg("enable"), 0, kStop); !done) return done;
  return write(profile_.reg("control"), profile_.number("reset_command"));
}

}  // namespace gantry
