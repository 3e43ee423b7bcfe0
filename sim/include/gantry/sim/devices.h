#pragma once

#include <memory>

#include "gantry/hal/drive.h"
#include "gantry/hal/scanner.h"
#include "gantry/sim/world.h"

namespace gantry {

/// One stage of the world as a Drive in this process: no protocol, for algorithms and tests.
std::unique_ptr<Drive> make_simulated_drive(const std::string& axis, SimulatedWorld& world, size_t index);

/// The world's sensor as a Scanner in this process.
std::unique_ptr<Scanner> make_simulated_scanner(SimulatedWorld& world);

}  // namespace gantry
