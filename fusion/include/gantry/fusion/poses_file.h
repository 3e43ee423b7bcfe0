#pragma once

#include <filesystem>
#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry {

/// Reads POSES.txt: for each scan four lines of four numbers, the row-major 4x4 world_from_scan in mm;
/// blank lines and # comments between. `unit_mm` brings the file's unit to mm (1000 for poses in metres).
/// Throws InputError (file, line, what was expected) when the file does not hold exactly `expected` rigid
/// poses.
std::vector<Pose> read_poses(const std::filesystem::path& path, size_t expected, double unit_mm = 1);

/// Writes the same format with full precision.
void write_poses(const std::filesystem::path& path, const std::vector<Pose>& poses);

}  // namespace gantry
