#pragma once

#include <span>
#include <string>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/point_index.h"
#include "gantry/inspection/distances.h"

namespace gantry::internal {

struct M3c2 {
  std::vector<float> distance_mm;  ///< Of each point of A; NaN where a cylinder holds too few points.
  std::vector<float> lod95_mm;     ///< Likewise.
  std::string note;                ///< Which scales were used.
};

/// M3C2 of Lague, Brodu and Leroux, "Accurate 3D comparison of complex topography with terrestrial laser
/// scanner", ISPRS J. 82, 2013. The core points are the points of A.
///
/// The normal is that of the least-squares plane through the points of A within D/2 of the core point; it
/// points as the normals that A has, else as those that the nearest point of B has, else upwards (+z). In the
/// cylinder of diameter d along it, to `depth` either side, the mean position along the axis is taken of A
/// and of B; their difference is the distance. Four points of either are asked for, fewer say nothing of
/// their scatter.
///
/// Scales that are 0 in the options are chosen: with s, the larger of the median distances of neighbours in A
/// and in B, d = 10 s (some 20 to 80 points), D = 20 s, depth = d + the 99th percentile of d(a, B).
///
/// `nearest`: for each point of A its nearest point of B.
M3c2 m3c2(const PointCloud& a, const PointIndex& a_index, const PointCloud& b, const PointIndex& b_index,
          std::span<const PointIndex::Neighbour> nearest, const DistanceOptions& options);

}  // namespace gantry::internal
