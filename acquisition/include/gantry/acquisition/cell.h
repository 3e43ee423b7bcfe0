#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gantry/acquisition/drive_settings.h"
#include "gantry/foundation/clock.h"
#include "gantry/hal/axis.h"
#include "gantry/hal/scanner.h"
#include "gantry/kinematics/chain.h"

namespace gantry {

struct AxisSettings {
  std::string name;
  AxisKind kind = AxisKind::kLinear;
  AxisLimits limits;
  double settle_s = 0.2;  ///< The axis must stand within its in-position band this long before a scan.
  DriveSettings drive;
};

struct ScannerSettings {
  std::string kind;     ///< "genicam3d" or "simulated".
  std::string address;  ///< IP address; genicam3d only.
};

/// A cell as described by CELL.yaml, without what only the simulation knows. The format is documented
/// in docs/files.md.
struct Cell {
  std::string name;
  std::string calibration_id;  ///< Recorded with every scan.
  std::filesystem::path file;
  std::vector<BusSettings> buses;  ///< That drives name.
  Chain chain;
  std::vector<AxisSettings> axes;  ///< In the order of the chain.
  ScannerSettings scanner;
  std::filesystem::path fixture;          ///< Mesh of the holder in the part frame; empty: none known.
  std::vector<std::string> homing_order;  ///< Names of axes.
};

/// Throws InputError with file, line and key for anything that is missing, unknown or contradictory.
Cell read_cell(const std::filesystem::path& path);

}  // namespace gantry
