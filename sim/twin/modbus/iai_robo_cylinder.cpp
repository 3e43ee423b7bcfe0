#include "iai_robo_cylinder.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace gantry {
namespace {

constexpr double kMmPerCount = 0.01;
/// One unit of ACMD is 0.01 G.
constexpr double kMmPerS2PerAccelerationUnit = 98.0665;

// Control bits within 0D00; coil 0400 + n is bit 15 - n.
constexpr uint16_t kServoOn = 1u << 12;    // 0403
constexpr uint16_t kAlarmReset = 1u << 8;  // 0407
constexpr uint16_t kPause = 1u << 5;       // 040A
constexpr uint16_t kHome = 1u << 4;        // 040B
constexpr uint16_t kControlBits = kServoOn | kAlarmReset | kPause | kHome;
constexpr int kControlCoils = 0x0400;
constexpr int kControlCoilsEnd = 0x0430;
constexpr int kModbusEnableCoil = 0x0427;
constexpr int kDecelerationStopCoil = 0x042C;
constexpr int kStatusCoils = 0x0100;
constexpr int kStatusCoilsEnd = 0x0130;

constexpr int kControlRegister = 0x0D00;
constexpr int kPositionNumberRegister = 0x0D03;
constexpr int kMonitors = 0x9000;
constexpr int kMonitorsEnd = 0x900C;
constexpr int kNumericalMove = 0x9900;
constexpr int kNumericalMoveEnd = 0x9909;

constexpr uint16_t kIncremental = 1u << 3;  // CTLF

constexpr int kAlarmServoOff = 0x080;
constexpr int kAlarmNotHomed = 0x083;
constexpr int kAlarmPositionData = 0x0A2;
constexpr int kAlarmCommandData = 0x0A3;

uint16_t bit(int number, bool on) {
  return static_cast<uint16_t>(on ? 1u << number : 0u);
}

int32_t to_counts(double value_mm) {
  return static_cast<int32_t>(std::lround(value_mm / kMmPerCount));
}

}  // namespace

IaiRoboCylinder::IaiRoboCylinder(SimulatedStage& stage) : stage_(stage) {
  const StageDynamics& dynamics = stage_.dynamics();
  command_.speed = to_counts(dynamics.max_speed);
  command_.acceleration = static_cast<uint16_t>(
      std::clamp(std::round(dynamics.max_acceleration / kMmPerS2PerAccelerationUnit), 1.0, 65535.0));
}

bool IaiRoboCylinder::serves(int function) const {
  return function == 0x01 || function == 0x02 || function == 0x03 || function == 0x05 || function == 0x06 ||
         function == 0x10;
}

int32_t IaiRoboCylinder::position_counts(const StageState& state) const {
  return to_counts(state.encoder_position);
}

uint16_t IaiRoboCylinder::device_status(const StageState& state) const {
  const bool homing = travel_ == Travel::kHome && !state.homed;
  const bool in_band = state.servo_on && !homing && paused_travel_ == Travel::kNone && target_ &&
                       std::abs(static_cast<int64_t>(position_counts(state)) - *target_) <= command_.band;
  return bit(15, emergency_stop_) | bit(13, true) | bit(12, state.servo_on) | bit(10, alarm_ != 0) |
         bit(5, control_ & kPause) | bit(4, state.homed) | bit(3, in_band);
}

uint16_t IaiRoboCylinder::extended_status(const StageState& state) const {
  const bool homing = travel_ == Travel::kHome && !state.homed;
  return bit(15, emergency_stop_) | bit(11, homing) | bit(8, modbus_enabled_) | bit(5, state.moving);
}

int32_t IaiRoboCylinder::system_status(const StageState& state) const {
  return bit(3, state.homed) | bit(2, state.servo_on) | bit(1, control_ & kServoOn) |
         bit(0, !emergency_stop_);
}

uint16_t IaiRoboCylinder::monitor(int address, const StageState& state) const {
  switch (address) {
    case 0x9000:
      return upper_word(position_counts(state));
    case 0x9001:
      return lower_word(position_counts(state));
    case 0x9002:
      return static_cast<uint16_t>(alarm_);
    case 0x9005:
      return device_status(state);
    case 0x9007:
      return extended_status(state);
    case 0x9008:
      return upper_word(system_status(state));
    case 0x9009:
      return lower_word(system_status(state));
    case 0x900A:
      return upper_word(to_counts(state.velocity));
    case 0x900B:
      return lower_word(to_counts(state.velocity));
    default:
      return 0;  // 9003, 9004: PIO ports; 9006: DSS2
  }
}

std::optional<uint16_t> IaiRoboCylinder::numerical_register(int address) const {
  switch (address) {
    case 0x9900:
      return upper_word(command_.target);
    case 0x9901:
      return lower_word(command_.target);
    case 0x9902:
      return upper_word(command_.band);
    case 0x9903:
      return lower_word(command_.band);
    case 0x9904:
      return upper_word(command_.speed);
    case 0x9905:
      return lower_word(command_.speed);
    case 0x9906:
      return command_.acceleration;
    case 0x9907:
      return command_.push_percent;
    case 0x9908:
      return command_.flags;
    default:
      return std::nullopt;
  }
}

ModbusAnswer<std::vector<uint16_t>> IaiRoboCylinder::read_registers(int address, int count, double now_s) {
  const StageState state = stage_.observe(now_s);
  std::vector<uint16_t> words;
  for (int a = address; a < address + count; ++a) {
    if (a >= kMonitors && a < kMonitorsEnd) {
      words.push_back(monitor(a, state));
    } else if (a == kControlRegister) {
      words.push_back(control_);
    } else if (const auto word = numerical_register(a)) {
      words.push_back(*word);
    } else {
      return tl::make_unexpected(ModbusException::kIllegalAddress);
    }
  }
  return words;
}

ModbusAnswer<std::vector<uint8_t>> IaiRoboCylinder::read_bits(int address, int count, double now_s) {
  const StageState state = stage_.observe(now_s);
  const uint16_t status[] = {device_status(state), 0, extended_status(state)};
  const uint16_t control[] = {control_, 0, bit(15 - (kModbusEnableCoil & 0xF), modbus_enabled_)};
  std::vector<uint8_t> bits;
  for (int a = address; a < address + count; ++a) {
    const uint16_t* words = nullptr;
    if (a >= kStatusCoils && a < kStatusCoilsEnd) words = status;
    if (a >= kControlCoils && a < kControlCoilsEnd) words = control;
    if (!words) return tl::make_unexpected(ModbusException::kIllegalAddress);
    bits.push_back(words[(a >> 4) & 0xF] >> (15 - (a & 0xF)) & 1);
  }
  return bits;
}

ModbusAnswer<void> IaiRoboCylinder::write_bit(int address, bool on, double now_s) {
  if (address == kModbusEnableCoil) {
    modbus_enabled_ = on;
    return {};
  }
  if (address == kDecelerationStopCoil) {
    if (on) stop_travel(now_s);
    return {};
  }
  const uint16_t mask =
      (address & ~0xF) == kControlCoils ? static_cast<uint16_t>(1u << (15 - (address & 0xF))) : 0;
  if (!(mask & kControlBits)) return tl::make_unexpected(ModbusException::kIllegalAddress);
  apply_control(static_cast<uint16_t>(on ? control_ | mask : control_ & ~mask), now_s);
  return {};
}

ModbusAnswer<void> IaiRoboCylinder::write_registers(int address, std::span<const uint16_t> words,
                                                    double now_s) {
  if (address == kControlRegister && words.size() == 1) {
    apply_control(words[0] & kControlBits, now_s);
    return {};
  }
  if (address == kPositionNumberRegister && words.size() == 1) {
    // The position table of the twin is empty.
    if (alarm_ == 0 && !emergency_stop_) raise_alarm(kAlarmPositionData, false, now_s);
    return {};
  }
  return write_numerical(address, words, now_s);
}

ModbusAnswer<void> IaiRoboCylinder::write_numerical(int address, std::span<const uint16_t> words,
                                                    double now_s) {
  const int end = address + static_cast<int>(words.size());
  const auto splits_a_pair = [](int a) { return a == 0x9901 || a == 0x9903 || a == 0x9905; };
  if (address < kNumericalMove || end > kNumericalMoveEnd || splits_a_pair(address) || splits_a_pair(end))
    return tl::make_unexpected(ModbusException::kIllegalAddress);
  const auto written = [&](int a) { return a >= address && a < end; };
  const auto word = [&](int a) { return words[static_cast<size_t>(a - address)]; };
  const auto pair = [&](int a) { return int32_from_words(word(a), word(a + 1)); };

  if (written(0x9900)) command_.target = pair(0x9900);
  if (written(0x9902)) command_.band = pair(0x9902);
  if (written(0x9904)) command_.speed = pair(0x9904);
  if (written(0x9906)) command_.acceleration = word(0x9906);
  if (written(0x9907)) command_.push_percent = word(0x9907);
  if (written(0x9908)) command_.flags = word(0x9908);

  if (written(0x9900)) {
    start_numerical_move(now_s);
  } else if ((written(0x9904) || written(0x9906) || written(0x9907)) && travel_ == Travel::kMove &&
             stage_.observe(now_s).velocity != 0) {
    run(Travel::kMove, now_s);
  }
  return {};
}

void IaiRoboCylinder::apply_control(uint16_t word, double now_s) {
  const uint16_t rising = word & ~control_;
  const uint16_t falling = control_ & ~word;
  control_ = word;

  if (rising & kAlarmReset) reset_alarm();
  if (falling & kServoOn) power_off(now_s);
  if (rising & kServoOn) {
    if (emergency_stop_ || alarm_ != 0) {
      control_ &= ~kServoOn;
    } else {
      stage_.set_servo(true, now_s);
      target_ = position_counts(stage_.observe(now_s));
    }
  }
  if (rising & kPause) {
    const StageState state = stage_.observe(now_s);
    const bool homing = travel_ == Travel::kHome && !state.homed;
    if (homing || state.velocity != 0) {
      paused_travel_ = travel_;
      stage_.halt(now_s);
    }
  }
  if (falling & kPause) {
    const Travel travel = paused_travel_;
    paused_travel_ = Travel::kNone;
    if (travel != Travel::kNone) run(travel, now_s);
  }
  if (rising & kHome && !emergency_stop_ && alarm_ == 0) {
    if (!stage_.observe(now_s).servo_on) {
      raise_alarm(kAlarmServoOff, false, now_s);
    } else if (control_ & kPause) {
      paused_travel_ = Travel::kHome;
    } else {
      run(Travel::kHome, now_s);
    }
  }
}

void IaiRoboCylinder::reset_alarm() {
  if (!alarm_persists_) alarm_ = 0;
  if (paused_travel_ != Travel::kNone) {
    paused_travel_ = Travel::kNone;
    travel_ = Travel::kNone;
    target_.reset();
  }
}

void IaiRoboCylinder::power_off(double now_s) {
  stop_travel(now_s);
  stage_.set_servo(false, now_s);
  control_ &= ~kServoOn;
}

void IaiRoboCylinder::stop_travel(double now_s) {
  if (stage_.observe(now_s).moving) target_.reset();
  stage_.halt(now_s);
  travel_ = Travel::kNone;
  paused_travel_ = Travel::kNone;
}

void IaiRoboCylinder::start_numerical_move(double now_s) {
  const bool incremental = command_.flags & kIncremental;
  command_.flags = 0;
  if (emergency_stop_ || alarm_ != 0) return;
  const StageState state = stage_.observe(now_s);
  if (!state.servo_on) return raise_alarm(kAlarmServoOff, false, now_s);
  if (!state.homed) return raise_alarm(kAlarmNotHomed, false, now_s);

  const int64_t base = incremental ? target_.value_or(position_counts(state)) : 0;
  const int64_t target = base + command_.target;
  const double target_mm = static_cast<double>(target) * kMmPerCount;
  const StageDynamics& dynamics = stage_.dynamics();
  const double margin_mm = kMmPerCount / 2;
  if (target_mm < dynamics.travel_min - margin_mm || target_mm > dynamics.travel_max + margin_mm ||
      command_.speed <= 0 || command_.acceleration == 0)
    return raise_alarm(kAlarmCommandData, false, now_s);

  target_ = static_cast<int32_t>(target);
  if (control_ & kPause) {
    paused_travel_ = Travel::kMove;
  } else {
    run(Travel::kMove, now_s);
  }
}

void IaiRoboCylinder::run(Travel travel, double now_s) {
  travel_ = travel;
  if (travel == Travel::kHome) {
    target_ = 0;
    stage_.start_homing(now_s);
  } else {
    stage_.start_move(*target_ * kMmPerCount, command_.speed * kMmPerCount,
                      command_.acceleration * kMmPerS2PerAccelerationUnit, now_s);
  }
}

void IaiRoboCylinder::raise_alarm(int code, bool persists, double now_s) {
  power_off(now_s);
  alarm_ = code;
  alarm_persists_ = persists;
}

void IaiRoboCylinder::set_emergency_stop(bool active, double now_s) {
  emergency_stop_ = active;
  if (active) power_off(now_s);
}

}  // namespace gantry
