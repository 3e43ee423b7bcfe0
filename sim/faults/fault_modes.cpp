#include <algorithm>

#include "gantry/sim/fault_schedule.h"

namespace gantry {

const std::vector<FaultModeInfo>& fault_modes() {
  using enum FaultMode;
  using enum FaultDevice;
  static const std::vector<FaultModeInfo> modes = {
      {kAxis, kStuck, "stuck", true},
      {kAxis, kRunaway, "runaway", true},
      {kAxis, kSlip, "slip", false},
      {kAxis, kDeadHomeSwitch, "dead_home_switch", true},
      {kAxis, kLimitBounce, "limit_bounce", true},
      {kAxis, kAlarm, "alarm", true},
      {kAxis, kEmergencyStop, "emergency_stop", true},
      {kAxis, kPowerLoss, "power_loss", true},
      {kAxis, kSilent, "silent", true},
      {kBus, kLoseRequest, "lose_request", true},
      {kBus, kDropReply, "drop_reply", true},
      {kBus, kDelayReply, "delay_reply", true},
      {kBus, kTruncateReply, "truncate_reply", true},
      {kBus, kCorruptReply, "corrupt_reply", true},
      {kBus, kDuplicateReply, "duplicate_reply", true},
      {kBus, kException, "exception", true},
      {kBus, kDisconnect, "disconnect", true},
      {kSafety, kPress, "press", true},
      {kSafety, kWireBreak, "wire_break", true},
      {kSafety, kStickContact, "stick_contact", true},
      {kCamera, kSilent, "silent", true},
      {kCamera, kDataLoss, "data_loss", true},
  };
  return modes;
}

std::string_view to_string(FaultMode mode) {
  const auto& modes = fault_modes();
  return std::find_if(modes.begin(), modes.end(), [&](const FaultModeInfo& m) { return m.mode == mode; })
      ->word;
}

std::string_view to_string(FaultDevice device) {
  switch (device) {
    case FaultDevice::kAxis:
      return "axis";
    case FaultDevice::kBus:
      return "bus";
    case FaultDevice::kSafety:
      return "safety";
    default:
      return "camera";
  }
}

std::string FaultEntry::text() const {
  std::string text(to_string(device));
  if (!name.empty()) text += " " + name;
  text += ": ";
  text += to_string(mode);
  return text;
}

}  // namespace gantry
