#include "modbus/kinds/cia402.h"

#include <cmath>
#include <cstdio>

namespace gantry {
namespace {

// Control word, 6040h.
constexpr uint16_t kDisableVoltage = 0x00, kQuickStop = 0x02, kShutdown = 0x06, kSwitchOn = 0x07,
                   kEnableOperation = 0x0F, kFaultReset = 0x80;
constexpr uint16_t kStartHoming = 1u << 4;
constexpr uint16_t kNewSetPoint = 1u << 4, kChangeAtOnce = 1u << 5;

// Status word, 6041h.
constexpr uint16_t kTargetReached = 1u << 10, kSetPointTaken = 1u << 12;

constexpr double kProfilePosition = 1, kHoming = 6;
/// Slow down on the quick stop ramp and stay in "quick stop active", under power.
constexpr double kStayAfterQuickStop = 6;
constexpr double kStateWithin_s = 0.25;
/// So soon after a halt a velocity of zero is not believed: drives filter it.
constexpr double kVelocityLag_s = 0.02;

enum class State {
  kNotReady,
  kSwitchOnDisabled,
  kReadyToSwitchOn,
  kSwitchedOn,
  kOperationEnabled,
  kQuickStopActive,
  kFault
};

State state_of(uint16_t status_word) {
  if (status_word & 1u << 3) return State::kFault;  // Its reaction included.
  if (status_word & 1u << 6) return State::kSwitchOnDisabled;
  switch (status_word & 0x27) {
    case 0x21:
      return State::kReadyToSwitchOn;
    case 0x23:
      return State::kSwitchedOn;
    case 0x27:
      return State::kOperationEnabled;
    case 0x07:
      return State::kQuickStopActive;
    default:
      return State::kNotReady;
  }
}

const char* name_of(State state) {
  switch (state) {
    case State::kNotReady:
      return "not ready to switch on";
    case State::kSwitchOnDisabled:
      return "switch on disabled";
    case State::kReadyToSwitchOn:
      return "ready to switch on";
    case State::kSwitchedOn:
      return "switched on";
    case State::kOperationEnabled:
      return "operation enabled";
    case State::kQuickStopActive:
      return "quick stop active";
    case State::kFault:
      return "fault";
  }
  return "unknown";
}

}  // namespace

Result<uint16_t> Cia402Drive::read_status_word() const {
  const auto words = unit_.read(profile_.reg("status_word").address, 1);
  if (!words) return tl::make_unexpected(words.error());
  return static_cast<uint16_t>(value_from_words(*words, RegisterType::kU16, profile_.word_order));
}

Result<void> Cia402Drive::control(uint16_t word, WriteHandling handling) const {
  return write(profile_.reg("control_word"), word, handling);
}

Result<void> Cia402Drive::await(const char* what, bool (*reached)(uint16_t)) const {
  const double deadline_s = clock_.now_s() + kStateWithin_s;
  for (;;) {
    const auto word = read_status_word();
    if (!word) return tl::make_unexpected(word.error());
    if (reached(*word)) return {};
    if (clock_.now_s() > deadline_s) {
      char text[160];
      std::snprintf(text, sizeof text, "%s: the drive did not follow (state \"%s\", status word %04Xh)", what,
                    name_of(state_of(*word)), *word);
      return unit_.refused(text);
    }
    clock_.sleep_s(0.005);
  }
}

Result<DriveStatus> Cia402Drive::read_status() {
  DriveStatus status;
  status.sampled_at_s = clock_.now_s();  // Before the exchanges: never younger than it claims.
  // The profile reads the status word before the position, as for every drive.
  const auto image = read_image();
  if (!image) return tl::make_unexpected(image.error());
  fill_common(status, *image);
  const auto word = static_cast<uint16_t>(image->value(profile_.reg("status_word")));
  const State state = state_of(word);
  status.servo_on = state == State::kOperationEnabled || state == State::kQuickStopActive;
  status.homed = image->bit(profile_.bit("homed"));
  if (state == State::kFault) {
    const auto code = value(*image, profile_.reg("alarm_code"));
    if (!code) return tl::make_unexpected(code.error());
    status.alarm = static_cast<int>(*code);
  }

  // "Target reached" speaks of operation only; that a stop has ended, or a motor without power has come to
  // rest, shows in the velocity alone.
  const bool reached = (word & kTargetReached) != 0;
  const double speed = std::abs(image->value(profile_.reg("velocity")));
  const bool just_halted = halted_at_s_ && status.sampled_at_s <= *halted_at_s_ + kVelocityLag_s;
  const bool under_way = speed > profile_.number("standstill_speed") ||
                         (state == State::kOperationEnabled && !reached) ||
                         (state == State::kQuickStopActive && just_halted);
  const bool arrived = reached && at_target(*image);
  const bool started = under_way || (target_counts_ ? arrived : !status.homed);
  const bool awaiting_start = start_.pending(started, status.sampled_at_s);
  status.moving = under_way || (awaiting_start && status.servo_on);
  status.in_position = arrived && !status.moving;
  return status;
}

Result<void> Cia402Drive::set_servo(bool on) {
  forget_motion();
  if (!on) return control(kDisableVoltage, kStop);
  const auto image = read_image();
  if (!image) return tl::make_unexpected(image.error());
  const State state = state_of(static_cast<uint16_t>(image->value(profile_.reg("status_word"))));
  if (state == State::kOperationEnabled) return {};
  if (state == State::kFault) return unit_.refused("power refused: the drive has a fault; reset it first");

  if (state == State::kQuickStopActive) {
    if (auto done = control(kDisableVoltage, kStop); !done) return done;
  }
  if (auto done = control(kShutdown, kSetting); !done) return done;
  const auto ready = [](uint16_t word) { return state_of(word) == State::kReadyToSwitchOn; };
  if (auto done = await("power", ready); !done) return done;
  if (const auto option = profile_.find_register("quick_stop_option")) {
    if (auto done = write(*option, kStayAfterQuickStop, kSetting); !done) return done;
  }
  // Nothing may be left of an older move: power finds the motor at its target.
  if (auto done = write(profile_.reg("mode"), kProfilePosition, kSetting); !done) return done;
  const double position = image->value(profile_.reg("position"));
  if (auto done = write(profile_.reg("target"), position, kSetting); !done) return done;
  if (auto done = control(kSwitchOn, kSetting); !done) return done;
  const auto switched_on = [](uint16_t word) { return state_of(word) == State::kSwitchedOn; };
  if (auto done = await("power", switched_on); !done) return done;
  if (auto done = control(kEnableOperation, kSetting); !done) return done;
  const auto enabled = [](uint16_t word) { return state_of(word) == State::kOperationEnabled; };
  return await("power", enabled);
}

Result<void> Cia402Drive::become_operational(const char* command) const {
  const auto word = read_status_word();
  if (!word) return tl::make_unexpected(word.error());
  const State state = state_of(*word);
  if (state == State::kOperationEnabled) return {};
  if (state != State::kQuickStopActive)
    return unit_.refused(std::string(command) + " refused: the drive is in state \"" + name_of(state) + "\"");
  if (auto done = control(kEnableOperation, kSetting); !done) return done;
  return await(command, [](uint16_t w) { return state_of(w) == State::kOperationEnabled; });
}

Result<void> Cia402Drive::start_homing() {
  forget_motion();
  if (auto done = become_operational("homing"); !done) return done;
  if (auto done = control(kEnableOperation, kSetting); !done) return done;  // The edge needs a 0 first.
  if (auto done = write(profile_.reg("mode"), kHoming, kSetting); !done) return done;
  if (auto done = control(kEnableOperation | kStartHoming); !done) return done;
  start_.commanded(clock_.now_s());
  return {};
}

// The set-point handshake: bit 4 rises, the drive answers with bit 12, bit 4 falls, bit 12 falls.
Result<void> Cia402Drive::start_move(const MoveCommand& command) {
  const double target = to_counts(command.target);
  constexpr double kAny = 4294967295.0;  // The registers' own types are the limit.
  const auto speed = rate(command.speed * counts_per_axis_unit_ * profile_.number("speed_per_count_s"), kAny);
  const auto slope =
      rate(command.acceleration * counts_per_axis_unit_ * profile_.number("acceleration_per_count_s2"), kAny);
  if (!speed || !slope || !encode({{"target", target}, {"speed", *speed}, {"acceleration", *slope}}))
    return does_not_fit();
  if (auto done = become_operational("move"); !done) return done;

  forget_motion();
  if (auto done = control(kEnableOperation | kChangeAtOnce, kSetting); !done) return done;
  if (auto done = write(profile_.reg("mode"), kProfilePosition, kSetting); !done) return done;
  if (auto done = write(profile_.reg("speed"), *speed, kSetting); !done) return done;
  if (auto done = write(profile_.reg("acceleration"), *slope, kSetting); !done) return done;
  if (auto done = write(profile_.reg("deceleration"), *slope, kSetting); !done) return done;
  if (auto done = write(profile_.reg("target"), target, kSetting); !done) return done;
  const auto not_taken = [](uint16_t word) { return (word & kSetPointTaken) == 0; };
  if (auto done = await("move", not_taken); !done) return done;
  if (auto done = control(kEnableOperation | kChangeAtOnce | kNewSetPoint); !done) return done;
  const auto taken = await("move", [](uint16_t word) { return (word & kSetPointTaken) != 0; });
  if (auto done = control(kEnableOperation | kChangeAtOnce, kSetting); !done) return done;
  if (!taken) return taken;
  target_counts_ = target;
  start_.commanded(clock_.now_s());
  return {};
}

Result<void> Cia402Drive::halt() {
  forget_motion();
  halted_at_s_ = clock_.now_s();
  return control(kQuickStop, kStop);
}

// Bit 7 is an edge, and the word that carries it asks for no power.
Result<void> Cia402Drive::reset_alarm() {
  forget_motion();
  if (auto done = control(kDisableVoltage, kStop); !done) return done;
  if (auto done = control(kFaultReset); !done) return done;
  return control(kDisableVoltage, kStop);
}

}  // namespace gantry
