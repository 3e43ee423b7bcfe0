#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gantry/acquisition/cell.h"

namespace gantry {

/// One place to scan from.
struct Viewpoint {
  std::string name;
  std::vector<double> q;  ///< Joint values, mm or rad, in the order of the chain.
  double exposure_s = 0.1;
  double dwell_s = 0;  ///< Extra wait after settling.
};

/// What a run does: the viewpoints in order, and how its result is judged.
struct Plan {
  std::filesystem::path file;
  std::string name;
  std::vector<Viewpoint> viewpoints;
  double tolerance_mm = 0.2;
  double crop_margin_mm = 10;  ///< Points further than this outside the part's bounding box are dropped.
};

/// Reads PLAN.yaml (docs/files.md) for this cell. A viewpoint is given as joint positions or as the
/// pose of the sensor relative to the part, which is turned into joint positions here. Throws
/// InputError naming file, line and viewpoint for anything wrong, soft limits and reach included.
Plan read_plan(const std::filesystem::path& path, const Cell& cell);

}  // namespace gantry
