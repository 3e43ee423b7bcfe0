#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "cell_safety.h"
#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/motion.h"
#include "gantry/hal/modbus_drives.h"
#include "gantry/hal/scanner.h"
#include "gantry/sim/world.h"

namespace gantry {

/// The devices of a cell as CELL.yaml names them: real backends, or simulated ones in this process.
/// Nothing is connected yet.
struct CellDevices {
  std::unique_ptr<SimulatedWorld> world;          ///< Only when a device is simulated in this process.
  std::vector<std::shared_ptr<ModbusBus>> buses;  ///< For their statistics.
  SafetyDevices safety;                           ///< Empty for a cell without a safety section.
  std::unique_ptr<Motion> motion;
  std::unique_ptr<Scanner> scanner;
  bool simulated = false;  ///< No real part is measured (in-process, or a twin on loopback).
  /// Every axis is simulated in this process: nobody else can see or disturb them.
  bool axes_in_process = false;
};

/// Motion runs on `threads` of its own, in real time, or as its caller waits. `part` replaces the mesh that
/// the simulation section names. Throws InputError when the cell needs a simulation section and has none.
CellDevices make_devices(const Cell& cell, const std::optional<std::filesystem::path>& part, uint64_t seed,
                         Clock& clock, bool threads = true);

/// The world of the cell's simulation section.
std::unique_ptr<SimulatedWorld> make_world(const Cell& cell, const std::optional<std::filesystem::path>& part,
                                           uint64_t seed, Clock& clock);

}  // namespace gantry
