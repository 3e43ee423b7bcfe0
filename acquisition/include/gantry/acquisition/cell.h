#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gantry/acquisition/collision_settings.h"
#include "gantry/acquisition/safety_settings.h"
#include "gantry/foundation/clock.h"
#include "gantry/hal/axis.h"
#include "gantry/hal/scanner.h"
#include "gantry/kinematics/chain.h"

namespace gantry {

/// How one axis is reached.
struct DriveSettings {
  std::string profile;  ///< "iai_robo_cylinder", "oriental_motor_az" or "simulated".
  std::string host;
  int port = 502;
  int unit = 1;
  double steps_per_revolution = 0;  ///< Of the load, after any gear; oriental_motor_az only.
};

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
  Chain chain;
  std::vector<AxisSettings> axes;  ///< In the order of the chain.
  ScannerSettings scanner;
  std::filesystem::path fixture;           ///< Mesh of the holder in the part frame; empty: none known.
  std::vector<std::string> homing_order;   ///< Names of axes.
  std::optional<CellCollision> collision;  ///< Absent: paths are not checked for collisions.
  std::optional<CellSafety> safety;  ///< Absent: no safety inputs are read; the hardware chain is alone.
};

/// Throws InputError with file, line and key for anything that is missing, unknown or contradictory.
Cell read_cell(const std::filesystem::path& path);

}  // namespace gantry
