#pragma once

#include <cstdint>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/signed_distance.h"
#include "judged_feet.h"

namespace gantry::internal {

/// The CAD surface by samples, each of which stands for the same area and was seen or not.
struct CoverageSamples {
  PointCloud surface;         ///< With the normals of their triangles.
  std::vector<int> triangle;  ///< Each sample lies on.
  std::vector<unsigned char> seen;
  double area_each_mm2 = 0;

  double fraction() const;  ///< Of the area, seen.
};

/// A sample is seen when a judged point stands within `radius_mm` of it on surface that faces the same way
/// (within 60 degrees); points beside the surface do not count. About two samples a square millimetre, 20 000
/// to 100 000 in all, with a fixed seed.
CoverageSamples sample_coverage(const SignedDistance& reference, const JudgedFeet& feet, double radius_mm);

}  // namespace gantry::internal
