#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace gantry {

/// The states of PLCopen Motion Control part 1 (V2.0, section 2.1) that a positioning axis needs.
enum class AxisState : uint8_t {
  kDisabled,    ///< No power on the motor.
  kStandstill,  ///< Powered, holding its position.
  kHoming,
  kDiscreteMotion,  ///< Moving to a target; jogging is a move to a bounded target.
  kStopping,
  kErrorStop  ///< An error was seen; only a reset leaves this state.
};
inline constexpr AxisState kAxisStates[] = {AxisState::kDisabled, AxisState::kStandstill,
                                            AxisState::kHoming,   AxisState::kDiscreteMotion,
                                            AxisState::kStopping, AxisState::kErrorStop};

/// What may change the state: commands, and what is then seen of the drive.
enum class AxisTrigger : uint8_t {
  kEnable,
  kDisable,
  kHome,
  kMove,
  kJog,
  kStop,
  kReset,
  kPowered,  ///< The drive reports its servo on, after enable.
  kDone,     ///< Homed, arrived, or come to rest.
  kCleared,  ///< The drive reports no alarm and no power, after reset.
  kFault     ///< Of this axis, of another axis, or of what watches over all.
};
inline constexpr AxisTrigger kAxisCommands[] = {
    AxisTrigger::kEnable, AxisTrigger::kDisable, AxisTrigger::kHome, AxisTrigger::kMove,
    AxisTrigger::kJog,    AxisTrigger::kStop,    AxisTrigger::kReset};

struct AxisTransition {
  AxisState from;
  AxisTrigger trigger;
  AxisState to;
};

/// Every transition there is. The state machine (axis_machine.h) asks this table, the tests walk through
/// it, and the diagram in docs/motion.md is printed from it. A command that has no line for the present
/// state is refused. Enable and reset keep the state until the drive has confirmed.
inline constexpr AxisTransition kAxisTransitions[] = {
    {AxisState::kDisabled, AxisTrigger::kEnable, AxisState::kDisabled},
    {AxisState::kDisabled, AxisTrigger::kDisable, AxisState::kDisabled},
    {AxisState::kDisabled, AxisTrigger::kPowered, AxisState::kStandstill},
    {AxisState::kDisabled, AxisTrigger::kFault, AxisState::kErrorStop},
    {AxisState::kStandstill, AxisTrigger::kDisable, AxisState::kDisabled},
    {AxisState::kStandstill, AxisTrigger::kHome, AxisState::kHoming},
    {AxisState::kStandstill, AxisTrigger::kMove, AxisState::kDiscreteMotion},
    {AxisState::kStandstill, AxisTrigger::kJog, AxisState::kDiscreteMotion},
    {AxisState::kStandstill, AxisTrigger::kStop, AxisState::kStopping},
    {AxisState::kStandstill, AxisTrigger::kFault, AxisState::kErrorStop},
    {AxisState::kHoming, AxisTrigger::kDone, AxisState::kStandstill},
    {AxisState::kHoming, AxisTrigger::kStop, AxisState::kStopping},
    {AxisState::kHoming, AxisTrigger::kFault, AxisState::kErrorStop},
    {AxisState::kDiscreteMotion, AxisTrigger::kDone, AxisState::kStandstill},
    {AxisState::kDiscreteMotion, AxisTrigger::kStop, AxisState::kStopping},
    {AxisState::kDiscreteMotion, AxisTrigger::kFault, AxisState::kErrorStop},
    {AxisState::kStopping, AxisTrigger::kDone, AxisState::kStandstill},
    {AxisState::kStopping, AxisTrigger::kStop, AxisState::kStopping},
    {AxisState::kStopping, AxisTrigger::kFault, AxisState::kErrorStop},
    {AxisState::kErrorStop, AxisTrigger::kReset, AxisState::kErrorStop},
    {AxisState::kErrorStop, AxisTrigger::kCleared, AxisState::kDisabled},
    {AxisState::kErrorStop, AxisTrigger::kFault, AxisState::kErrorStop},
};

/// The state after `trigger`; nothing when it is not allowed in `from`.
constexpr std::optional<AxisState> next_state(AxisState from, AxisTrigger trigger) {
  for (const AxisTransition& t : kAxisTransitions)
    if (t.from == from && t.trigger == trigger) return t.to;
  return std::nullopt;
}

constexpr bool is_powered(AxisState state) {
  return state != AxisState::kDisabled && state != AxisState::kErrorStop;
}

std::string_view to_string(AxisState state);      ///< "Disabled", ...
std::string_view to_string(AxisTrigger trigger);  ///< "enable", ..., "powered", ...

/// The table as a Mermaid state diagram, as docs/motion.md shows it.
std::string axis_state_diagram();

}  // namespace gantry
