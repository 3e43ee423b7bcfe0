#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry {

/// One exposure of a 3D sensor: points in the `sensor` frame (x right, y down, z out of the lens), mm,
/// row by row as on the sensor's chip. A pixel without a measurement holds NaN in all three
/// coordinates. A scan whose neighbourhood was lost (height == 1) is unorganised.
struct Scan {
  int width = 0;
  int height = 0;
  std::vector<Eigen::Vector3f> points;  ///< width * height entries, row-major.

  bool organised() const { return height > 1; }
  size_t index(int column, int row) const { return static_cast<size_t>(row) * width + column; }
  bool valid(size_t i) const { return std::isfinite(points[i].z()); }
  size_t valid_count() const {
    size_t count = 0;
    for (size_t i = 0; i < points.size(); ++i) count += valid(i);
    return count;
  }
};

inline Eigen::Vector3f invalid_point() {
  return Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN());
}

/// A scan with what is known of where it was taken: the result of forward kinematics at the time of
/// exposure, or an initial guess read from a file. It carries all that fusion needs of the cell.
struct TaggedScan {
  std::string name;  ///< Viewpoint or file name, for messages and results.
  Scan scan;
  UncertainPose part_from_sensor;
};

}  // namespace gantry
