#include "leadshine_cs2rs.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace gantry {
namespace {

constexpr int kPulsesPerRevolution = 0x0001, kForcedEnable = 0x000F, kStatus = 0x1003, kAuxiliary = 0x1801,
              kAlarm = 0x2203, kTrigger = 0x6002, kCommandPosition = 0x602A, kMotorPosition = 0x602C,
              kInputs = 0x602E, kPath = 0x6200, kPathEnd = 0x6208;

constexpr uint16_t kRunPath0 = 0x10, kHome = 0x20, kStop = 0x40, kResetAlarm = 0x1111;
constexpr uint16_t kAbsolute = 0x0001, kRelative = 0x0041;
enum PathWord { kMode, kHighPosition, kLowPosition, kRpm, kRampUp, kRampDown, kDelay, kPathTrigger };

constexpr int kAlarmFollowingError = 0x20;

uint16_t bit(int number, bool on) {
  return static_cast<uint16_t>(on ? 1u << number : 0u);
}

}  // namespace

LeadshineCs2rs::LeadshineCs2rs(SimulatedStage& stage, double axis_units_per_pulse)
    : stage_(stage), axis_units_per_pulse_(axis_units_per_pulse) {}

bool LeadshineCs2rs::serves(int function) const {
  return function == 0x03 || function == 0x06 || function == 0x10;
}

int32_t LeadshineCs2rs::position(const StageState& state) const {
  return static_cast<int32_t>(std::lround(state.encoder_position / axis_units_per_pulse_));
}

uint16_t LeadshineCs2rs::status(const StageState& state) const {
  return bit(0, alarm_ != 0) | bit(1, state.servo_on) | bit(2, state.moving) | bit(4, !state.moving) |
         bit(5, path_completes_ && !state.moving) | bit(6, state.homed);
}

// As they are assigned at commissioning: DI4 quick stop, DI5 lower and DI6 upper limit.
uint16_t LeadshineCs2rs::inputs(const StageState& state) const {
  return bit(3, emergency_stop_) | bit(4, state.true_position <= stage_.dynamics().travel_min) |
         bit(5, state.true_position >= stage_.dynamics().travel_max);
}

std::optional<uint16_t> LeadshineCs2rs::word_at(int address, const StageState& state) const {
  const int32_t actual = position(state);
  const int32_t command = state.moving ? actual : command_.value_or(actual);
  if (address >= kPath && address < kPathEnd) return path_[static_cast<size_t>(address - kPath)];
  switch (address) {
    case kPulsesPerRevolution - 1:
    case kForcedEnable - 1:
      return 0;
    case kPulsesPerRevolution:
      return pulses_per_revolution_;
    case kForcedEnable:
      return forced_enable_;
    case kStatus:
      return status(state);
    case kAlarm:
      return static_cast<uint16_t>(alarm_);
    case kTrigger:
      return 0;
    case kCommandPosition:
      return upper_word(command);
    case kCommandPosition + 1:
      return lower_word(command);
    case kMotorPosition:
      return upper_word(actual);
    case kMotorPosition + 1:
      return lower_word(actual);
    case kInputs:
      return inputs(state);
    default:
      return std::nullopt;
  }
}

ModbusAnswer<std::vector<uint16_t>> LeadshineCs2rs::read_registers(int address, int count, double now_s) {
  catch_up(now_s);
  const StageState state = stage_.observe(now_s);
  std::vector<uint16_t> words;
  for (int a = address; a < address + count; ++a) {
    const auto word = word_at(a, state);
    if (!word) return tl::make_unexpected(ModbusException::kIllegalAddress);
    words.push_back(*word);
  }
  return words;
}

ModbusAnswer<std::vector<uint8_t>> LeadshineCs2rs::read_bits(int, int, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

ModbusAnswer<void> LeadshineCs2rs::write_bit(int, bool, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

/// Whether a writable register takes this value.
bool LeadshineCs2rs::accepts(int address, uint16_t word) const {
  switch (address) {
    case kPulsesPerRevolution:
      return word >= 200 && word <= 51200;
    case kForcedEnable:
      return word <= 1;
    case kTrigger:
    case kPath + kPathTrigger:
      return word == 0 || word == kRunPath0 || word == kHome || word == kStop;
    case kPath + kMode:
      return word == kAbsolute || word == kRelative;
    default:
      return true;
  }
}

ModbusAnswer<void> LeadshineCs2rs::write_registers(int address, std::span<const uint16_t> words,
                                                   double now_s) {
  catch_up(now_s);
  const int end = address + static_cast<int>(words.size());
  for (int a = address; a < end; ++a) {
    const bool writable = (a >= kPath && a < kPathEnd) || a == kPulsesPerRevolution || a == kForcedEnable ||
                          a == kPulsesPerRevolution - 1 || a == kForcedEnable - 1 || a == kAuxiliary ||
                          a == kTrigger;
    if (!writable) return tl::make_unexpected(ModbusException::kIllegalAddress);
    if (!accepts(a, words[static_cast<size_t>(a - address)]))
      return tl::make_unexpected(ModbusException::kIllegalValue);
  }
  for (int a = address; a < end; ++a) write_word(a, words[static_cast<size_t>(a - address)], now_s);
  return {};
}

void LeadshineCs2rs::write_word(int address, uint16_t word, double now_s) {
  if (address >= kPath && address < kPathEnd) path_[static_cast<size_t>(address - kPath)] = word;
  if (address == kPulsesPerRevolution) pulses_per_revolution_ = word;
  // Pr9.07 is mapped to Pr8.02.
  if (address == kTrigger || address == kPath + kPathTrigger) trigger(word, now_s);
  if (address == kForcedEnable) {
    forced_enable_ = word != 0 && !emergency_stop_;
    follow_power(now_s);
  }
  if (address == kAuxiliary && word == kResetAlarm && !alarm_persists_) {
    alarm_ = 0;
    follow_power(now_s);
  }
}

// Whatever changes it, the motor has power exactly while it is enabled and nothing is wrong.
void LeadshineCs2rs::follow_power(double now_s) {
  const bool on = stage_.observe(now_s).servo_on;
  if (powered() == on) return;
  if (on) {
    stage_.halt(now_s);
    path_completes_ = false;
  }
  hits_the_end_ = false;
  command_.reset();
  stage_.set_servo(!on, now_s);
}

void LeadshineCs2rs::trigger(uint16_t word, double now_s) {
  if (word == kStop) {
    if (stage_.observe(now_s).moving) {
      path_completes_ = false;
      command_.reset();
    }
    hits_the_end_ = false;
    stage_.halt(now_s);
  }
  if (!powered()) return;
  if (word == kRunPath0) run_path(now_s);
  if (word == kHome) {
    command_ = 0;
    path_completes_ = true;
    hits_the_end_ = false;
    stage_.start_homing(now_s);
  }
}

void LeadshineCs2rs::run_path(double now_s) {
  if (path_[kRpm] == 0) return;
  const StageState state = stage_.observe(now_s);
  int64_t target = int32_from_words(path_[kHighPosition], path_[kLowPosition]);
  if (path_[kMode] == kRelative) target += command_.value_or(position(state));
  target =
      std::clamp<int64_t>(target, std::numeric_limits<int32_t>::min(), std::numeric_limits<int32_t>::max());

  const double units_per_revolution = pulses_per_revolution_ * axis_units_per_pulse_;
  const double speed = path_[kRpm] / 60.0 * units_per_revolution;
  // A ramp is given as the milliseconds from rest to 1000 rpm; the stage knows one for both ways.
  const double ramp_ms = std::max<double>(1, std::max(path_[kRampUp], path_[kRampDown]));
  const double acceleration = 1000.0 / 60.0 * units_per_revolution / (ramp_ms / 1000.0);

  const double offset = state.homed ? 0.0 : state.encoder_position - state.true_position;
  const double stage_target = static_cast<double>(target) * axis_units_per_pulse_ - offset;
  const double margin = axis_units_per_pulse_ / 2;
  hits_the_end_ = stage_target < stage_.dynamics().travel_min - margin ||
                  stage_target > stage_.dynamics().travel_max + margin;
  command_ = static_cast<int32_t>(target);
  path_completes_ = true;
  stage_.start_move(stage_target, speed, acceleration, now_s);
}

// Against the end of the travel the motor stays behind its command.
void LeadshineCs2rs::catch_up(double now_s) {
  if (hits_the_end_ && !stage_.observe(now_s).moving) raise_alarm(kAlarmFollowingError, false, now_s);
}

void LeadshineCs2rs::raise_alarm(int code, bool persists, double now_s) {
  alarm_ = code;
  alarm_persists_ = persists;
  follow_power(now_s);
}

void LeadshineCs2rs::set_emergency_stop(bool active, double now_s) {
  emergency_stop_ = active;
  if (active) forced_enable_ = false;
  follow_power(now_s);
}

}  // namespace gantry
