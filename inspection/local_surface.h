#pragma once

#include <vector>

#include "gantry/geometry/point_cloud.h"

namespace gantry::internal {

/// Points moved along their normals onto the surface that they and their neighbours sample.
struct LocalSurface {
  std::vector<Eigen::Vector3f> points;
  std::vector<float> sigma_mm;  ///< Standard uncertainty of each, along its normal.
  std::vector<unsigned char>
      supported;  ///< 0: too few neighbours on the same face, or on an edge: no smooth surface.
  std::vector<unsigned char> rim;  ///< 1: neighbours lie to one side only, the value is an extrapolation.
  double spacing_mm = 0;           ///< Median distance of neighbouring points.
};

/// Moving least squares: for every point the plane through its neighbours within `radius_mm` (at least
/// twice the points' spacing) whose normals agree, weighted by 1 / (sigma^2 + systematic^2), for points
/// of several scans also differ by what registration left over; a quadratic surface where
/// they scatter about that plane by more than their noise. Noise is averaged away, the tip of a burr is
/// not. Levin, "The approximation power of moving least-squares", 1998.
LocalSurface fit_local_surface(const PointCloud& cloud, double radius_mm, double systematic_sigma_mm);

}  // namespace gantry::internal
