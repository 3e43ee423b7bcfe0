#include "gantry/sim/physical_faults.h"

#include <algorithm>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

std::optional<StageFault> stage_fault_of(const FaultEntry& entry) {
  switch (entry.mode) {
    case FaultMode::kStuck:
      return StageFault::kStuck;
    case FaultMode::kRunaway:
      return entry.upwards ? StageFault::kRunawayUp : StageFault::kRunawayDown;
    case FaultMode::kDeadHomeSwitch:
      return StageFault::kDeadHomeSwitch;
    case FaultMode::kLimitBounce:
      return StageFault::kLimitBounce;
    default:
      return std::nullopt;
  }
}

}  // namespace

PhysicalFaults::PhysicalFaults(SimulatedWorld& world, std::vector<std::string> axes, SafetyContacts* contacts)
    : world_(world), axes_(std::move(axes)), contacts_(contacts) {}

size_t PhysicalFaults::axis(const FaultEntry& entry) const {
  const auto found = std::find(axes_.begin(), axes_.end(), entry.name);
  if (found == axes_.end()) throw InputError("faults: there is no axis '" + entry.name + "'");
  return static_cast<size_t>(found - axes_.begin());
}

bool PhysicalFaults::begin(const FaultEntry& entry) {
  return act_on_stage(entry, true) || act_on_contacts(entry, true);
}

bool PhysicalFaults::end(const FaultEntry& entry) {
  return act_on_stage(entry, false) || act_on_contacts(entry, false);
}

bool PhysicalFaults::act_on_stage(const FaultEntry& entry, bool begins) {
  if (entry.device != FaultDevice::kAxis) return false;
  const double now_s = world_.clock().now_s();
  SimulatedStage& stage = world_.stage(axis(entry));
  if (entry.mode == FaultMode::kSlip) {
    stage.slip(entry.distance, now_s);
    return true;
  }
  const auto fault = stage_fault_of(entry);
  if (!fault) return false;
  if (begins) {
    stage.inject(*fault, now_s);
  } else {
    stage.clear(*fault, now_s);
  }
  return true;
}

bool PhysicalFaults::act_on_contacts(const FaultEntry& entry, bool begins) {
  if (entry.device != FaultDevice::kSafety) return false;
  if (!contacts_) throw InputError("faults: there are no safety contacts for '" + entry.name + "'");
  if (entry.mode == FaultMode::kPress) {
    if (begins) {
      contacts_->press(entry.name, entry.lag_s);
    } else {
      contacts_->release(entry.name);
    }
    return true;
  }
  const auto& devices = contacts_->devices();
  const auto device = std::find_if(devices.begin(), devices.end(),
                                   [&](const SafetyDevice& d) { return d.name == entry.name; });
  if (device == devices.end()) throw InputError("faults: there is no safety input '" + entry.name + "'");
  const int channel = device->channels.at(static_cast<size_t>(entry.contact));
  if (!begins)
    contacts_->mend(channel);
  else if (entry.mode == FaultMode::kWireBreak)
    contacts_->break_wire(channel);
  else
    contacts_->stick(channel);
  return true;
}

std::optional<WireFault> wire_fault_of(FaultMode mode) {
  switch (mode) {
    case FaultMode::kLoseRequest:
      return WireFault::kLoseRequest;
    case FaultMode::kDropReply:
      return WireFault::kDropReply;
    case FaultMode::kDelayReply:
      return WireFault::kDelayReply;
    case FaultMode::kTruncateReply:
      return WireFault::kTruncateReply;
    case FaultMode::kCorruptReply:
      return WireFault::kCorruptReply;
    case FaultMode::kDuplicateReply:
      return WireFault::kDuplicateReply;
    case FaultMode::kException:
      return WireFault::kException;
    default:
      return std::nullopt;
  }
}

}  // namespace gantry
