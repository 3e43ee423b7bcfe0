#pragma once

#include <filesystem>

#include "gantry/geometry/pose.h"
#include "gantry/geometry/scan.h"

namespace gantry {

/// A scan as read from a file, with the pose of its sensor where the file holds one.
struct ScanFile {
  Scan scan;
  UncertainPose part_from_sensor;
  bool has_pose = false;         ///< A VIEWPOINT other than the identity, or a covariance, was present.
  bool has_uncertainty = false;  ///< The covariance was present.
};

/// Reads PCD (organised or not; its VIEWPOINT is part_from_sensor) or PLY (ascii, binary, with a
/// range_grid: organised). PCD of this program stores points in the sensor frame. `unit_mm` is the
/// file's unit in mm. Throws InputError naming the file when it is missing, broken or without points.
ScanFile read_scan(const std::filesystem::path& path, double unit_mm = 1.0);

/// Writes organised binary PCD, points in the sensor frame, part_from_sensor as VIEWPOINT. The file
/// appears under its name only when it is complete and synced to disk; throws InputError if that fails.
void write_scan(const std::filesystem::path& path, const Scan& scan, const Pose& part_from_sensor);

/// The same, with the pose's uncertainty in comments of the header, which other readers of PCD skip:
///   # gantry calibration nominal-2026-01
///   # gantry independent a b c d e f        six times, the rows of the covariance
///   # gantry shared a b c d e f             one line for each parameter: a column of the shared factor
void write_scan(const std::filesystem::path& path, const Scan& scan, const UncertainPose& part_from_sensor);

}  // namespace gantry
