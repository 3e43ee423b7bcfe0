#include "oriental_motor_az.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

namespace gantry {
namespace {

constexpr int kDirectData = 0x0058;
constexpr int kDirectDataEnd = 0x0068;
constexpr int kInputs = 0x007C;
constexpr int kInputsEnd = 0x007E;

// 007D
constexpr uint16_t kStart = 1u << 3;
constexpr uint16_t kZHome = 1u << 4;
constexpr uint16_t kStop = 1u << 5;
constexpr uint16_t kFree = 1u << 6;
constexpr uint16_t kAlarmReset = 1u << 7;

// Types of operation that a limited axis can do.
constexpr int32_t kAbsolute = 1;
constexpr int32_t kIncrementalFromCommand = 2;
constexpr int32_t kIncrementalFromFeedback = 3;

constexpr int kAlarmNotHomed = 0x4A;
constexpr int kAlarmOvertravel = 0x67;
constexpr int kAlarmEmergencyStop = 0x68;
constexpr int kAlarmOperationData = 0x70;
constexpr int kAlarmCommunicationTimeout = 0x85;
constexpr int32_t kMaxCommunicationTimeout_ms = 10'000;

constexpr int64_t kInPositionSteps = 10;

struct Range {
  int32_t min, max;
};
/// In the order of the items.
constexpr Range kRanges[] = {{0, 255},
                             {kAbsolute, kIncrementalFromFeedback},
                             {std::numeric_limits<int32_t>::min(), std::numeric_limits<int32_t>::max()},
                             {-4'000'000, 4'000'000},
                             {1, 1'000'000'000},
                             {1, 1'000'000'000},
                             {0, 1000},
                             {-7, 1}};

uint16_t bit(int number, bool on) {
  return static_cast<uint16_t>(on ? 1u << number : 0u);
}

}  // namespace

OrientalMotorAz::OrientalMotorAz(SimulatedStage& stage, double axis_units_per_step, double now_s,
                                 int communication_timeout_address)
    : stage_(stage),
      axis_units_per_step_(axis_units_per_step),
      communication_timeout_address_(communication_timeout_address),
      heard_at_s_(now_s) {
  energise(now_s);
}

bool OrientalMotorAz::serves(int function) const {
  return function == 0x03 || function == 0x06 || function == 0x08 || function == 0x10;
}

int32_t OrientalMotorAz::feedback_steps(const StageState& state) const {
  return static_cast<int32_t>(std::lround(state.encoder_position / axis_units_per_step_));
}

int32_t OrientalMotorAz::command_steps(const StageState& state) const {
  return state.moving ? feedback_steps(state) : command_.value_or(feedback_steps(state));
}

bool OrientalMotorAz::may_start() const {
  return alarm_ == 0 && !(inputs_ & (kFree | kStop));
}

uint16_t OrientalMotorAz::outputs(const StageState& state) const {
  const int64_t deviation = static_cast<int64_t>(feedback_steps(state)) - command_steps(state);
  return bit(3, inputs_ & kStart) | bit(4, state.homed) | bit(5, may_start() && !state.moving) |
         bit(7, alarm_ != 0) | bit(13, state.moving) |
         bit(14, state.servo_on && !state.moving && std::abs(deviation) <= kInPositionSteps);
}

std::optional<int32_t> OrientalMotorAz::item(int even_address, const StageState& state) const {
  if (even_address >= kDirectData && even_address < kDirectDataEnd)
    return direct_[static_cast<size_t>(even_address - kDirectData) / 2];
  if (even_address == communication_timeout_address_ && even_address != 0) return communication_timeout_ms_;
  switch (even_address) {
    case 0x007C:
      return inputs_;
    case 0x007E:
      return outputs(state);
    case 0x0080:
      return alarm_;
    case 0x00C6:
    case 0x0122:
      return command_steps(state);
    case 0x00CC:
    case 0x0120:
      return feedback_steps(state);
    case 0x00D0:
      return static_cast<int32_t>(std::lround(state.velocity / axis_units_per_step_));
    default:
      return std::nullopt;
  }
}

ModbusAnswer<std::vector<uint16_t>> OrientalMotorAz::read_registers(int address, int count, double now_s) {
  catch_up(now_s);
  const StageState state = stage_.observe(now_s);
  std::vector<uint16_t> words;
  for (int a = address; a < address + count; ++a) {
    const auto value = item(a & ~1, state);
    if (!value) return tl::make_unexpected(ModbusException::kIllegalAddress);
    words.push_back(a & 1 ? lower_word(*value) : upper_word(*value));
  }
  return words;
}

ModbusAnswer<std::vector<uint8_t>> OrientalMotorAz::read_bits(int, int, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

ModbusAnswer<void> OrientalMotorAz::write_bit(int, bool, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

ModbusAnswer<void> OrientalMotorAz::write_registers(int address, std::span<const uint16_t> words,
                                                    double now_s) {
  catch_up(now_s);
  const int end = address + static_cast<int>(words.size());
  if (address >= kInputs && end <= kInputsEnd) {
    if (end == kInputsEnd) apply_inputs(words.back(), now_s);
    return {};
  }
  if (address == communication_timeout_address_ && address != 0 && words.size() == 2) {
    const int32_t timeout_ms = int32_from_words(words[0], words[1]);
    if (timeout_ms < 0 || timeout_ms > kMaxCommunicationTimeout_ms)
      return tl::make_unexpected(ModbusException::kDeviceFailure);
    communication_timeout_ms_ = timeout_ms;
    return {};
  }
  if (address >= kDirectData && end <= kDirectDataEnd) return write_direct_data(address, words, now_s);
  return tl::make_unexpected(ModbusException::kIllegalAddress);
}

ModbusAnswer<void> OrientalMotorAz::write_direct_data(int address, std::span<const uint16_t> words,
                                                      double now_s) {
  auto data = direct_;
  std::array<bool, kItems> completed{};  // the lower word, written last, makes an item count as written
  for (size_t i = 0; i < words.size(); ++i) {
    const int a = address + static_cast<int>(i);
    const size_t index = static_cast<size_t>(a - kDirectData) / 2;
    int32_t& value = data[index];
    value =
        a & 1 ? int32_from_words(upper_word(value), words[i]) : int32_from_words(words[i], lower_word(value));
    completed[index] = a & 1;
  }
  for (size_t index = 0; index < kItems; ++index)
    if (data[index] < kRanges[index].min || data[index] > kRanges[index].max)
      return tl::make_unexpected(ModbusException::kDeviceFailure);
  direct_ = data;
  const int32_t trigger = direct_[kTrigger];
  const bool all = trigger == 1 && completed[kTrigger];
  const bool named = trigger < 0 && completed[static_cast<size_t>(trigger + kTrigger)];
  if (all || named) start_direct_operation(now_s);
  return {};
}

void OrientalMotorAz::start_direct_operation(double now_s) {
  if (!may_start()) return;
  const StageState state = stage_.observe(now_s);
  const int32_t type = direct_[kType];
  if (type == kAbsolute && !state.homed) return raise_alarm(kAlarmNotHomed, false, now_s);
  if (direct_[kSpeed] == 0) return raise_alarm(kAlarmOperationData, false, now_s);

  int64_t target = direct_[kPosition];
  if (type == kIncrementalFromCommand) target += command_steps(state);
  if (type == kIncrementalFromFeedback) target += feedback_steps(state);
  target =
      std::clamp<int64_t>(target, std::numeric_limits<int32_t>::min(), std::numeric_limits<int32_t>::max());
  command_ = static_cast<int32_t>(target);
  // Before homing the encoder has an offset that the stage's own coordinate does not have.
  const double offset = state.homed ? 0.0 : state.encoder_position - state.true_position;
  const double stage_target = static_cast<double>(target) * axis_units_per_step_ - offset;
  const StageDynamics& dynamics = stage_.dynamics();
  const double margin = axis_units_per_step_ / 2;
  overtravelling_ =
      stage_target < dynamics.travel_min - margin || stage_target > dynamics.travel_max + margin;
  stage_.start_move(stage_target, std::abs(direct_[kSpeed]) * axis_units_per_step_,
                    std::min(direct_[kStartRate], direct_[kStopRate]) * axis_units_per_step_, now_s);
}

void OrientalMotorAz::heard(double now_s) {
  const double silent_until_s = heard_at_s_ + communication_timeout_ms_ / 1e3;
  heard_at_s_ = now_s;
  // The motor was stopped then, not only now that somebody asks again.
  if (communication_timeout_ms_ > 0 && now_s > silent_until_s)
    raise_alarm(kAlarmCommunicationTimeout, false, silent_until_s);
}

void OrientalMotorAz::catch_up(double now_s) {
  if (overtravelling_ && !stage_.observe(now_s).moving) raise_alarm(kAlarmOvertravel, false, now_s);
}

void OrientalMotorAz::apply_inputs(uint16_t inputs, double now_s) {
  const uint16_t rising = inputs & ~inputs_;
  const uint16_t falling = inputs_ & ~inputs;
  inputs_ = inputs;

  if (rising & kFree) power_off(now_s);
  if (rising & kAlarmReset && alarm_ != 0 && !alarm_persists_ && !emergency_stop_) {
    alarm_ = 0;
    energise(now_s);
  }
  if (falling & kFree) energise(now_s);
  if (rising & kStop) {
    if (stage_.observe(now_s).moving) command_.reset();
    overtravelling_ = false;
    stage_.halt(now_s);
  }
  // START runs stored operation data; the factory's is an incremental move by nothing.
  if (rising & kZHome && may_start()) {
    overtravelling_ = false;
    command_ = 0;
    stage_.start_homing(now_s);
  }
}

void OrientalMotorAz::energise(double now_s) {
  if (alarm_ != 0 || inputs_ & kFree) return;
  command_.reset();
  stage_.set_servo(true, now_s);
}

void OrientalMotorAz::power_off(double now_s) {
  overtravelling_ = false;
  command_.reset();
  stage_.halt(now_s);
  stage_.set_servo(false, now_s);
}

void OrientalMotorAz::raise_alarm(int code, bool persists, double now_s) {
  power_off(now_s);
  alarm_ = code;
  alarm_persists_ = persists;
}

void OrientalMotorAz::set_emergency_stop(bool active, double now_s) {
  emergency_stop_ = active;
  if (active) raise_alarm(kAlarmEmergencyStop, false, now_s);
}

}  // namespace gantry
