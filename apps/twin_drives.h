#pragma once

#include <memory>
#include <vector>

#include "gantry/acquisition/cell.h"
#include "gantry/sim/safety_contacts.h"
#include "gantry/sim/twin/modbus_drives.h"
#include "gantry/sim/world.h"

namespace gantry {

/// The drives of the cell on their endpoints: Modbus TCP at the addresses that the cell names, and for its
/// serial buses pseudo-terminals, where the simulation section lists them:
///
///   simulation:
///     serial: [{ bus: rs485, link: /tmp/gantry-rs485, honest_wire_time: true }]
///
/// `contacts`, if not null, are what the cell's safety I/O module is wired to.
/// Throws InputError for a drive that the twin does not have, and for a serial bus that is not listed.
std::vector<std::unique_ptr<ModbusDriveServer>> serve_drives(const Cell& cell, SimulatedWorld& world,
                                                             const SafetyContacts* contacts, Clock& clock);

}  // namespace gantry
