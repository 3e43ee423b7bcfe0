#include "modbus/oriental_motor_az.h"

#include <cstdio>

#include "modbus/axis_counts.h"
#include "modbus/word_codec.h"

namespace gantry {
namespace {

constexpr uint16_t kDirectData = 0x0058;
constexpr uint16_t kInputCommand = 0x007C;

// Input command, output status and present alarm are neighbours: one read.
constexpr uint16_t kStatusBlock = 0x007C;
constexpr uint16_t kStatusWords = 6;
constexpr size_t kInputWord = 0x007D - kStatusBlock;
constexpr size_t kOutputWord = 0x007F - kStatusBlock;
constexpr size_t kAlarmCode = 0x0080 - kStatusBlock;

constexpr uint16_t kPositions = 0x0120;
constexpr uint16_t kPositionWords = 4;
constexpr size_t kFeedbackPosition = 0x0120 - kPositions;
constexpr size_t kCommandPosition = 0x0122 - kPositions;

constexpr uint16_t kReturnToHome = 1u << 4;
constexpr uint16_t kStop = 1u << 5;
constexpr uint16_t kFree = 1u << 6;
constexpr uint16_t kAlarmReset = 1u << 7;

constexpr uint16_t kCoordinatesSet = 1u << 4;  // R-OUT4 assigned to ABSPEN.
constexpr uint16_t kReady = 1u << 5;
constexpr uint16_t kAlarm = 1u << 7;
constexpr uint16_t kMove = 1u << 13;
constexpr uint16_t kInPosition = 1u << 14;

constexpr int32_t kAbsolutePositioning = 1;
constexpr int32_t kFullCurrent = 1000;  // 0.1 %
constexpr int32_t kTriggerAll = 1;
constexpr int32_t kMaxSpeed_Hz = 4'000'000;
constexpr int32_t kMaxRate = 1'000'000'000;  // 0.001 kHz/s, which is one step/s^2.
constexpr int32_t kEmergencyStopAlarm = 0x68;

constexpr double kReadyWithin_s = 0.1;

}  // namespace

OrientalMotorAzDrive::OrientalMotorAzDrive(ModbusUnit unit, double steps_per_axis_unit, Clock& clock)
    : unit_(std::move(unit)), steps_per_axis_unit_(steps_per_axis_unit), clock_(clock) {}

void OrientalMotorAzDrive::forget_motion() {
  target_steps_.reset();
  start_.forget();
}

Result<void> OrientalMotorAzDrive::connect() {
  const auto block = unit_.first_read(kStatusBlock, kStatusWords);
  if (!block) return tl::make_unexpected(block.error());
  motor_free_ = ((*block)[kInputWord] & kFree) != 0;
  return {};
}

Result<OrientalMotorAzDrive::Words> OrientalMotorAzDrive::read_words() {
  const auto block = unit_.read(kStatusBlock, kStatusWords);
  if (!block) return tl::make_unexpected(block.error());
  const Words words{(*block)[kInputWord], (*block)[kOutputWord], word_pair(*block, kAlarmCode)};
  motor_free_ = (words.input & kFree) != 0;
  return words;
}

Result<DriveStatus> OrientalMotorAzDrive::read_status() {
  DriveStatus status;
  status.sampled_at_s = clock_.now_s();  // Before the exchanges: never younger than it claims.
  // In this order: when the words say standstill, the position is that of the standstill.
  const auto words = read_words();
  if (!words) return tl::make_unexpected(words.error());
  const auto positions = unit_.read(kPositions, kPositionWords);
  if (!positions) return tl::make_unexpected(positions.error());

  status.position = word_pair(*positions, kFeedbackPosition) / steps_per_axis_unit_;
  const bool alarm = (words->output & kAlarm) != 0;
  if (alarm) status.alarm = words->alarm;
  status.emergency_stop = alarm && words->alarm == kEmergencyStopAlarm;
  // The motor is energised from power-on; there is no servo-on bit to read.
  status.servo_on = !alarm && !motor_free_;
  status.homed = (words->output & kCoordinatesSet) != 0;

  const bool under_way = (words->output & kMove) != 0;
  // IN-POS speaks of any operation; the command position tells whether it was ours: it gets to our
  // target only when our move has run.
  const bool at_target = target_steps_ && word_pair(*positions, kCommandPosition) == *target_steps_;
  const bool started = under_way || (target_steps_ ? at_target : !status.homed);
  const bool awaiting_start = start_.pending(started, status.sampled_at_s);
  status.moving = under_way || (awaiting_start && status.servo_on);
  status.in_position = at_target && !status.moving && (words->output & kInPosition) != 0;
  return status;
}

Result<void> OrientalMotorAzDrive::write_input(uint16_t bits) {
  const uint16_t words[] = {0, bits};
  auto done = unit_.write(kInputCommand, words);
  if (done) motor_free_ = (bits & kFree) != 0;
  return done;
}

// The drive ignores a start without a word while it is not ready, so ask first. READY needs a moment
// to follow the release of STOP.
Result<void> OrientalMotorAzDrive::become_ready(const char* command) {
  auto words = read_words();
  if (!words) return tl::make_unexpected(words.error());
  if (words->input & (kStop | kReturnToHome | kAlarmReset)) {
    if (auto done = write_input(words->input & kFree); !done) return done;
  }
  const double deadline_s = clock_.now_s() + kReadyWithin_s;
  for (;;) {
    words = read_words();
    if (!words) return tl::make_unexpected(words.error());
    if (words->output & kReady) return {};
    if (clock_.now_s() > deadline_s) break;
    clock_.sleep_s(0.005);
  }
  char state[64];
  std::snprintf(state, sizeof state, " (input %04Xh, output %04Xh, alarm %02Xh)", words->input, words->output,
                static_cast<unsigned>(words->alarm));
  return unit_.refused(std::string(command) + " refused: the drive is not ready" + state);
}

Result<void> OrientalMotorAzDrive::set_servo(bool on) {
  forget_motion();
  return write_input(on ? 0 : kFree);
}

Result<void> OrientalMotorAzDrive::start_homing() {
  forget_motion();
  if (auto ready = become_ready("return to home"); !ready) return ready;
  if (auto done = write_input(kReturnToHome); !done) return done;
  start_.commanded(clock_.now_s());
  return {};
}

Result<void> OrientalMotorAzDrive::start_move(const MoveCommand& command) {
  const auto target = to_counts(command.target, steps_per_axis_unit_);
  const auto speed = to_rate_counts(command.speed, steps_per_axis_unit_, kMaxSpeed_Hz);
  const auto rate = to_rate_counts(command.acceleration, steps_per_axis_unit_, kMaxRate);
  if (!target || !speed || !rate)
    return fault(FaultKind::kLimit, info().text(),
                 "move refused: target, speed or acceleration does not fit into the drive's registers");
  if (auto ready = become_ready("move"); !ready) return ready;

  forget_motion();
  std::vector<uint16_t> operation;
  for (const int32_t item :
       {0, kAbsolutePositioning, *target, *speed, *rate, *rate, kFullCurrent, kTriggerAll})
    append_words(operation, item);
  if (auto done = unit_.write(kDirectData, operation); !done) return done;
  target_steps_ = *target;
  start_.commanded(clock_.now_s());
  return {};
}

// STOP stays on until the next start: while it is on, nothing can start the motor.
Result<void> OrientalMotorAzDrive::halt() {
  forget_motion();
  return write_input(static_cast<uint16_t>(kStop | (motor_free_ ? kFree : 0)));
}

// With FREE on, because the reset alone would put the motor under power.
Result<void> OrientalMotorAzDrive::reset_alarm() {
  forget_motion();
  if (auto done = write_input(kFree); !done) return done;
  if (auto done = write_input(kFree | kAlarmReset); !done) return done;
  return write_input(kFree);
}

}  // namespace gantry
