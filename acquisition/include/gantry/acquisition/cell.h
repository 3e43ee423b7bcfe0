#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gantry/acquisition/collision_settings.h"
#include "gantry/acquisition/drive_settings.h"
#include "gantry/acquisition/safety_settings.h"
#include "gantry/acquisition/supervisor.h"
#include "gantry/foundation/clock.h"
#include "gantry/hal/axis.h"
#include "gantry/hal/scanner.h"
#include "gantry/kinematics/chain.h"

namespace gantry {

/// Every target is approached from one side, so that play in the drive train always lies on the same side.
enum class Approach { kAny, kFromBelow, kFromAbove };

struct AxisSettings {
  std::string name;
  AxisKind kind = AxisKind::kLinear;
  AxisLimits limits;
  double settle_s = 0.2;  ///< The axis must stand within its in-position band this long before a scan.
  Approach approach = Approach::kAny;
  double approach_distance = 0;  ///< The last way to a target is at least so long, from that side.
  DriveSettings drive;

  /// The targets that can be approached as wanted without leaving the soft limits.
  double lowest_target() const;
  double highest_target() const;
};

/// Names of axes that home together, in the order of the groups.
using HomingOrder = std::vector<std::vector<std::string>>;

struct ScannerSettings {
  std::string kind;     ///< "genicam3d" or "simulated".
  std::string address;  ///< IP address; genicam3d only.
};

/// A cell as described by CELL.yaml, without what only the simulation knows. The format is documented
/// in docs/files.md.
struct Cell {
  std::string name;
  std::string calibration_id;  ///< Recorded with every scan.
  std::optional<std::chrono::sys_days> calibrated_on;
  std::filesystem::path file;
  std::vector<BusSettings> buses;  ///< That drives name.
  Chain chain;
  std::vector<AxisSettings> axes;  ///< In the order of the chain.
  ScannerSettings scanner;
  std::filesystem::path fixture;  ///< Mesh of the holder in the part frame; empty: none known.
  HomingOrder homing_order;
  SupervisorSettings supervisor;
  double drive_timeout_s = 0;  ///< A drive stops when it hears nothing for so long; 0: not asked for.
  std::optional<CellCollision> collision;  ///< Absent: paths are not checked for collisions.
  std::optional<CellSafety> safety;  ///< Absent: no safety inputs are read; the hardware chain is alone.
};

/// Throws InputError with file, line and key for anything that is missing, unknown or contradictory.
Cell read_cell(const std::filesystem::path& path);

}  // namespace gantry
