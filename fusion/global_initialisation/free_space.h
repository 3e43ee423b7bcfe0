#pragma once

#include <cstddef>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"

namespace gantry {

/// What a sensor at the origin of a cloud's frame looked through to see the cloud: a coarse range image
/// of decimated points, cells a little wider than their spacing.
class FreeSpace {
 public:
  /// Throws InputError when the cloud does not lie in front of the origin.
  FreeSpace(const PointCloud& cloud, double spacing_mm);

  enum class Seen {
    kPossible,    ///< On or behind the surface.
    kInFront,     ///< Where the sensor looked through: nothing can be there.
    kBackground,  ///< Beside the surface, where the sensor saw nothing: mostly nothing is there.
  };
  Seen at(const Eigen::Vector3d& point) const;

 private:
  double cell_, margin_mm_;
  Eigen::Vector2d low_;
  Eigen::Matrix3d image_from_cloud_;
  int width_ = 0, height_ = 0;
  std::vector<float> nearest_;  ///< Least range in the cell and the eight around it; infinite: no data.
};

}  // namespace gantry
