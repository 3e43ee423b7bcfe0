#include "kinco_fd.h"

#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

constexpr int kControlWord = 0x3100, kStatusWord = 0x3200, kQuickStopOption = 0x3400, kMode = 0x3500,
              kActualPosition = 0x3700, kActualVelocity = 0x3B00, kTargetPosition = 0x4000,
              kProfileVelocity = 0x4A00, kAcceleration = 0x4B00, kDeceleration = 0x4C00,
              kHomingMethod = 0x4D00, kInputs = 0x6D00, kErrorState = 0x1F00;

constexpr int32_t kProfilePositionMode = 1, kHomingMode = 6;

// Bits of the control word.
constexpr uint16_t kNewSetPoint = 1u << 4, kChangeAtOnce = 1u << 5, kRelative = 1u << 6,
                   kFaultReset = 1u << 7, kHalt = 1u << 8;

constexpr int kFollowingError = 0x0020;

bool is_32_bit(int address) {
  return address == kActualPosition || address == kActualVelocity || address == kTargetPosition ||
         address == kProfileVelocity || address == kAcceleration || address == kDeceleration ||
         address == kInputs;
}

bool writable(int address) {
  return address == kControlWord || address == kQuickStopOption || address == kMode ||
         address == kTargetPosition || address == kProfileVelocity || address == kAcceleration ||
         address == kDeceleration || address == kHomingMethod;
}

int32_t bit(int number, bool on) {
  return on ? 1 << number : 0;
}

// 1 rpm is 512 * resolution / 1875 DEC, and resolution / 60 counts per second.
double counts_per_s(int32_t dec) {
  return static_cast<double>(static_cast<uint32_t>(dec)) * 1875.0 / 512.0 / 60.0;
}
double counts_per_s2(int32_t dec) {
  return static_cast<double>(static_cast<uint32_t>(dec)) * 4e6 / 65536.0;
}

}  // namespace

KincoFd::KincoFd(SimulatedStage& stage, double axis_units_per_count)
    : stage_(stage), axis_units_per_count_(axis_units_per_count) {}

bool KincoFd::serves(int function) const {
  return function == 0x03 || function == 0x06 || function == 0x10;
}

int32_t KincoFd::position(const StageState& state) const {
  return static_cast<int32_t>(std::lround(state.encoder_position / axis_units_per_count_));
}

uint16_t KincoFd::status_word(const StageState& state) const {
  int32_t word = 0;
  switch (power_) {
    case Power::kSwitchOnDisabled:
      word = 0x60;
      break;
    case Power::kReady:
      word = 0x21;
      break;
    case Power::kSwitchedOn:
      word = 0x23;
      break;
    case Power::kEnabled:
      word = 0x27;
      break;
    case Power::kQuickStop:
      word = 0x07;
      break;
    case Power::kFault:
      word = 0x28;
      break;
  }
  const bool homing_attained = state.homed && !state.moving;
  return static_cast<uint16_t>(word | bit(4, !locked_) | bit(10, !state.moving) |
                               bit(12, mode_ == kHomingMode ? homing_attained : acknowledged_) |
                               bit(15, state.homed));
}

std::optional<int32_t> KincoFd::object(int address, const StageState& state) const {
  const StageDynamics& dynamics = stage_.dynamics();
  switch (address) {
    case kControlWord:
      return control_;
    case kStatusWord:
      return status_word(state);
    case kQuickStopOption:
      return quick_stop_option_;
    case kMode:
      return mode_;
    case kActualPosition:
      return position(state);
    case kActualVelocity:
      return static_cast<int32_t>(std::lround(state.velocity / axis_units_per_count_ * 60 * 512 / 1875));
    case kTargetPosition:
      return target_;
    case kProfileVelocity:
      return velocity_;
    case kAcceleration:
      return acceleration_;
    case kDeceleration:
      return deceleration_;
    case kHomingMethod:
      return homing_method_;
    case kInputs:
      return bit(0, state.true_position <= dynamics.travel_min) |
             bit(1, state.true_position >= dynamics.travel_max) | bit(3, locked_);
    case kErrorState:
      return error_;
    default:
      return std::nullopt;
  }
}

ModbusAnswer<std::vector<uint16_t>> KincoFd::read_registers(int address, int count, double now_s) {
  catch_up(now_s);
  const auto value = object(address, stage_.observe(now_s));
  if (!value || count > 2) return tl::make_unexpected(ModbusException::kIllegalAddress);
  std::vector<uint16_t> words{lower_word(*value), is_32_bit(address) ? upper_word(*value) : uint16_t{0}};
  words.resize(static_cast<size_t>(count));
  return words;
}

ModbusAnswer<std::vector<uint8_t>> KincoFd::read_bits(int, int, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

ModbusAnswer<void> KincoFd::write_bit(int, bool, double) {
  return tl::make_unexpected(ModbusException::kIllegalFunction);
}

ModbusAnswer<void> KincoFd::write_registers(int address, std::span<const uint16_t> words, double now_s) {
  catch_up(now_s);
  if (!writable(address) || words.size() != (is_32_bit(address) ? 2u : 1u))
    return tl::make_unexpected(ModbusException::kIllegalAddress);
  const int32_t value =
      words.size() == 2 ? int32_from_words(words[1], words[0]) : static_cast<int16_t>(words[0]);
  switch (address) {
    case kControlWord:
      set_control_word(words[0], now_s);
      break;
    case kQuickStopOption:
      if (value < 0 || value > 6) return tl::make_unexpected(ModbusException::kIllegalValue);
      quick_stop_option_ = value;
      break;
    case kMode:
      if (value != kProfilePositionMode && value != kHomingMode)
        return tl::make_unexpected(ModbusException::kIllegalValue);
      if (value != mode_) acknowledged_ = false;
      mode_ = value;
      break;
    case kTargetPosition:
      target_ = value;
      break;
    case kProfileVelocity:
      velocity_ = value;
      break;
    case kAcceleration:
      acceleration_ = value;
      break;
    case kDeceleration:
      deceleration_ = value;
      break;
    default:
      homing_method_ = value;
      break;
  }
  return {};
}

void KincoFd::set_control_word(uint16_t word, double now_s) {
  const uint16_t rising = word & ~control_;
  const uint16_t falling = control_ & ~word;
  control_ = word;
  if (power_ == Power::kFault) {
    if (rising & kFaultReset && !error_persists_) {
      error_ = 0;
      enter(Power::kSwitchOnDisabled, now_s);
    }
    return;
  }
  change_power(word, now_s);
  if (falling & kNewSetPoint && !set_point_waits_) acknowledged_ = false;
  if (power_ != Power::kEnabled) return;

  if (rising & kHalt) stage_.halt(now_s);
  if (rising & kNewSetPoint) {
    if (mode_ == kHomingMode) {
      set_point_ = 0;
      hits_the_end_ = false;
      stage_.start_homing(now_s);
    } else if (!acknowledged_) {
      take_set_point(now_s);
    }
  }
  // Without halt again, the drive goes on to where it was told to go.
  if (falling & kHalt && mode_ == kProfilePositionMode && set_point_ && !(rising & kNewSetPoint))
    start_move(now_s);
}

// CiA 402, table of the commands of the control word.
void KincoFd::change_power(uint16_t word, double now_s) {
  const bool disable_voltage = (word & 0x02) == 0;
  const bool stop = (word & 0x06) == 0x02;
  const bool shutdown = (word & 0x07) == 0x06;
  const bool switch_on = (word & 0x0F) == 0x07;
  const bool enable = (word & 0x0F) == 0x0F;
  switch (power_) {
    case Power::kSwitchOnDisabled:
      if (shutdown && !locked_) enter(Power::kReady, now_s);
      return;
    case Power::kReady:
    case Power::kSwitchedOn:
      if (disable_voltage || stop) return enter(Power::kSwitchOnDisabled, now_s);
      if (shutdown) return enter(Power::kReady, now_s);
      if (switch_on) return enter(Power::kSwitchedOn, now_s);
      if (enable) enter(Power::kEnabled, now_s);
      return;
    case Power::kEnabled:
      if (disable_voltage) return enter(Power::kSwitchOnDisabled, now_s);
      if (stop) return quick_stop(now_s);
      if (shutdown) return enter(Power::kReady, now_s);
      if (switch_on) enter(Power::kSwitchedOn, now_s);
      return;
    case Power::kQuickStop:
      if (disable_voltage) return enter(Power::kSwitchOnDisabled, now_s);
      if (enable) enter(Power::kEnabled, now_s);
      return;
    case Power::kFault:
      return;
  }
}

void KincoFd::enter(Power power, double now_s) {
  const auto has_power = [](Power p) { return p == Power::kEnabled || p == Power::kQuickStop; };
  const bool had = has_power(power_);
  power_ = power;
  if (had == has_power(power)) return;
  hits_the_end_ = set_point_waits_ = acknowledged_ = false;
  set_point_.reset();
  if (had) stage_.halt(now_s);
  stage_.set_servo(!had, now_s);
}

void KincoFd::quick_stop(double now_s) {
  stage_.halt(now_s);
  set_point_.reset();
  hits_the_end_ = set_point_waits_ = acknowledged_ = false;
  enter(Power::kQuickStop, now_s);
}

void KincoFd::take_set_point(double now_s) {
  if (!(control_ & kChangeAtOnce) && stage_.observe(now_s).moving) {
    set_point_waits_ = true;
    return;
  }
  set_point_waits_ = false;
  acknowledged_ = true;
  const int32_t base = control_ & kRelative ? set_point_.value_or(position(stage_.observe(now_s))) : 0;
  set_point_ = static_cast<int32_t>(static_cast<uint32_t>(base) + static_cast<uint32_t>(target_));
  if (!(control_ & kHalt)) start_move(now_s);
}

void KincoFd::start_move(double now_s) {
  const StageState state = stage_.observe(now_s);
  const double offset = state.homed ? 0.0 : state.encoder_position - state.true_position;
  const double stage_target = *set_point_ * axis_units_per_count_ - offset;
  const double margin = axis_units_per_count_ / 2;
  hits_the_end_ = stage_target < stage_.dynamics().travel_min - margin ||
                  stage_target > stage_.dynamics().travel_max + margin;
  if (velocity_ == 0) return;
  stage_.start_move(stage_target, counts_per_s(velocity_) * axis_units_per_count_,
                    counts_per_s2(static_cast<int32_t>(std::min(static_cast<uint32_t>(acceleration_),
                                                                static_cast<uint32_t>(deceleration_)))) *
                        axis_units_per_count_,
                    now_s);
}

void KincoFd::catch_up(double now_s) {
  const bool moving = stage_.observe(now_s).moving;
  if (hits_the_end_ && !moving) return raise_alarm(kFollowingError, false, now_s);
  if (set_point_waits_ && !moving) take_set_point(now_s);
  // Quick stop options up to 3 end without power; 5 and more stay.
  if (power_ == Power::kQuickStop && quick_stop_option_ < 5 && !moving)
    enter(Power::kSwitchOnDisabled, now_s);
}

void KincoFd::raise_alarm(int code, bool persists, double now_s) {
  error_ = code;
  error_persists_ = persists;
  enter(Power::kFault, now_s);
}

void KincoFd::set_emergency_stop(bool active, double now_s) {
  locked_ = active;
  if (active && power_ != Power::kFault) enter(Power::kSwitchOnDisabled, now_s);
}

}  // namespace gantry
