#include "gantry/hal/axis_states.h"

namespace gantry {

std::string_view to_string(AxisState state) {
  switch (state) {
    case AxisState::kDisabled:
      return "Disabled";
    case AxisState::kStandstill:
      return "Standstill";
    case AxisState::kHoming:
      return "Homing";
    case AxisState::kDiscreteMotion:
      return "DiscreteMotion";
    case AxisState::kStopping:
      return "Stopping";
    case AxisState::kErrorStop:
      return "ErrorStop";
  }
  return "unknown";
}

std::string_view to_string(AxisTrigger trigger) {
  switch (trigger) {
    case AxisTrigger::kEnable:
      return "enable";
    case AxisTrigger::kDisable:
      return "disable";
    case AxisTrigger::kHome:
      return "home";
    case AxisTrigger::kMove:
      return "move";
    case AxisTrigger::kJog:
      return "jog";
    case AxisTrigger::kStop:
      return "stop";
    case AxisTrigger::kReset:
      return "reset";
    case AxisTrigger::kPowered:
      return "powered";
    case AxisTrigger::kDone:
      return "done";
    case AxisTrigger::kCleared:
      return "cleared";
    case AxisTrigger::kFault:
      return "fault";
  }
  return "unknown";
}

std::string axis_state_diagram() {
  std::string text = "stateDiagram-v2\n  [*] --> Disabled\n";
  for (const AxisTransition& t : kAxisTransitions) {
    text += "  ";
    text += to_string(t.from);
    text += " --> ";
    text += to_string(t.to);
    text += ": ";
    text += to_string(t.trigger);
    text += '\n';
  }
  return text;
}

}  // namespace gantry
