#pragma once

#include <memory>
#include <vector>

#include "gantry/acquisition/cell.h"
#include "gantry/sim/twin/modbus_drives.h"
#include "gantry/sim/world.h"

namespace gantry {

/// The drives of the cell on their endpoints: Modbus TCP at the addresses that the cell names, and for its
/// serial buses pseudo-terminals, where the simulation section lists them:
///
///   simulation:
///     serial: [{ bus: rs485, link: /tmp/gantry-rs485, honest_wire_time: true }]
///
/// Throws InputError for a drive that the twin does not have, and for a serial bus that is not listed.
std::vector<std::unique_ptr<ModbusDriveServer>> serve_drives(const Cell& cell, SimulatedWorld& world,
                                                             Clock& clock);

}  // namespace gantry
