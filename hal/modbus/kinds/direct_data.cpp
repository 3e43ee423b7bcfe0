#include "modbus/kinds/direct_data.h"

#include <cstdio>

namespace gantry {
namespace {

constexpr double kAbsolutePositioning = 1;
constexpr double kFullCurrent = 1000;  // 0.1 %
constexpr double kTriggerAll = 1;
constexpr double kReadyWithin_s = 0.1;

}  // namespace

Result<StatusImage> DirectDataDrive::read_and_note_free() {
  auto image = read_image();
  if (image) motor_free_ = image->bit(profile_.bit("free"));
  return image;
}

Result<void> DirectDataDrive::connect() {
  if (auto connected = RegisterDrive::connect(); !connected) return connected;
  if (auto image = read_and_note_free(); !image) return tl::make_unexpected(image.error());
  return {};
}

Result<DriveStatus> DirectDataDrive::read_status() {
  DriveStatus status;
  status.sampled_at_s = clock_.now_s();  // Before the exchanges: never younger than it claims.
  // The profile reads the words before the positions: when the words say standstill, the position is that of
  // the standstill.
  const auto image = read_and_note_free();
  if (!image) return tl::make_unexpected(image.error());
  fill_common(status, *image);
  const bool alarm = image->bit(profile_.bit("alarm"));
  if (alarm) {
    const auto code = value(*image, profile_.reg("alarm_code"));
    if (!code) return tl::make_unexpected(code.error());
    status.alarm = static_cast<int>(*code);
    status.emergency_stop = *code == profile_.number("emergency_stop_alarm");
  }
  // There is no servo-on bit to read.
  status.servo_on = !alarm && !motor_free_;
  status.homed = image->bit(profile_.bit("homed"));

  const bool under_way = image->bit(profile_.bit("moving"));
  // The in-position bit speaks of any operation; the command position tells whether it was ours: it gets to
  // our target only when our move has run.
  const bool ours = target_counts_ && image->value(profile_.reg("command_position")) == *target_counts_;
  const bool started = under_way || (target_counts_ ? ours : !status.homed);
  const bool awaiting_start = start_.pending(started, status.sampled_at_s);
  status.moving = under_way || (awaiting_start && status.servo_on);
  status.in_position = ours && !status.moving && image->bit(profile_.bit("in_position"));
  return status;
}

Result<void> DirectDataDrive::write_input(uint32_t bits, WriteHandling handling) {
  auto done = write(profile_.reg("input"), bits, handling);
  if (done) motor_free_ = (bits & input_mask("free")) != 0;
  return done;
}

// The drive ignores a start without a word while it is not ready, so ask first. READY needs a moment
// to follow the release of STOP.
Result<void> DirectDataDrive::become_ready(const char* command) {
  const auto input_of = [&](const StatusImage& image) {
    return static_cast<uint32_t>(image.value(profile_.reg("input")));
  };
  auto image = read_and_note_free();
  if (!image) return tl::make_unexpected(image.error());
  const uint32_t in_the_way = input_mask("stop") | input_mask("return_to_home") | input_mask("alarm_reset");
  if (input_of(*image) & in_the_way) {
    if (auto done = write_input(input_of(*image) & input_mask("free")); !done) return done;
  }
  const double deadline_s = clock_.now_s() + kReadyWithin_s;
  for (;;) {
    image = read_and_note_free();
    if (!image) return tl::make_unexpected(image.error());
    if (image->bit(profile_.bit("ready"))) return {};
    if (clock_.now_s() > deadline_s) break;
    clock_.sleep_s(0.005);
  }
  const auto code = value(*image, profile_.reg("alarm_code"));
  if (!code) return tl::make_unexpected(code.error());
  char state[64];
  std::snprintf(state, sizeof state, " (input %04Xh, output %04Xh, alarm %02Xh)", input_of(*image),
                static_cast<unsigned>(image->value(profile_.reg("output"))), static_cast<unsigned>(*code));
  return unit_.refused(std::string(command) + " refused: the drive is not ready" + state);
}

Result<void> DirectDataDrive::set_servo(bool on) {
  forget_motion();
  return on ? write_input(0, kSetting) : write_input(input_mask("free"), kStop);
}

Result<void> DirectDataDrive::start_homing() {
  forget_motion();
  if (auto ready = become_ready("return to home"); !ready) return ready;
  if (auto done = write_input(input_mask("return_to_home")); !done) return done;
  start_.commanded(clock_.now_s());
  return {};
}

Result<void> DirectDataDrive::start_move(const MoveCommand& command) {
  const double target = to_counts(command.target);
  const auto speed = rate(command.speed * counts_per_axis_unit_, profile_.number("max_speed"));
  const auto slope = rate(command.acceleration * counts_per_axis_unit_, profile_.number("max_rate"));
  if (!speed || !slope) return does_not_fit();
  const auto operation = encode({{"data_number", 0},
                                 {"operation_type", kAbsolutePositioning},
                                 {"target", target},
                                 {"speed", *speed},
                                 {"starting_rate", *slope},
                                 {"stopping_rate", *slope},
                                 {"current", kFullCurrent},
                                 {"trigger", kTriggerAll}});
  if (!operation) return tl::make_unexpected(operation.error());
  if (auto ready = become_ready("move"); !ready) return ready;

  forget_motion();
  if (auto done = unit_.write(profile_.reg("data_number").address, *operation); !done) return done;
  target_counts_ = target;
  start_.commanded(clock_.now_s());
  return {};
}

// STOP stays on until the next start: while it is on, nothing can start the motor.
Result<void> DirectDataDrive::halt() {
  forget_motion();
  return write_input(input_mask("stop") | (motor_free_ ? input_mask("free") : 0), kStop);
}

// With FREE on, because the reset alone would put the motor under power.
Result<void> DirectDataDrive::reset_alarm() {
  forget_motion();
  const uint32_t free = input_mask("free");
  if (auto done = write_input(free, kSetting); !done) return done;
  if (auto done = write_input(free | input_mask("alarm_reset")); !done) return done;
  return write_input(free, kSetting);
}

}  // namespace gantry
