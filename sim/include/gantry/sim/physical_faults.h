#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gantry/sim/fault_schedule.h"
#include "gantry/sim/safety_contacts.h"
#include "gantry/sim/twin/wire_faults.h"
#include "gantry/sim/world.h"

namespace gantry {

/// The faults that need no protocol: of the stages' mechanics and of the safety contacts. In this process
/// and behind a twin's servers they are the same.
class PhysicalFaults {
 public:
  /// `axes`: names, in the order of the world's stages. `contacts` may be null. Both outlive this object.
  PhysicalFaults(SimulatedWorld& world, std::vector<std::string> axes, SafetyContacts* contacts);

  /// False for a fault that is somebody else's.
  bool begin(const FaultEntry& entry);
  bool end(const FaultEntry& entry);
  /// Index of the entry's axis. Throws InputError for a name that there is not.
  size_t axis(const FaultEntry& entry) const;

 private:
  bool act_on_stage(const FaultEntry& entry, bool begins);
  bool act_on_contacts(const FaultEntry& entry, bool begins);

  SimulatedWorld& world_;
  const std::vector<std::string> axes_;
  SafetyContacts* const contacts_;
};

/// What a mode of a bus is on the wire; nothing for any other.
std::optional<WireFault> wire_fault_of(FaultMode mode);

}  // namespace gantry
