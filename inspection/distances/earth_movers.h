#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace gantry::internal {

struct EarthMovers {
  double mean_mm = 0;              ///< Over the points of the smaller cloud.
  double error_bound_mm = 0;       ///< 0: exact.
  size_t group = 1;                ///< Points that share a representative; 1: exact.
  std::vector<float> distance_mm;  ///< Of each point of A to its partner; NaN for points without.
};

/// Earth Mover's distance of two clouds (see Metric::kEarthMovers).
///
/// Exact while the product of the clouds' sizes is at most that of two clouds of `exact_points`. Beyond, both
/// are cut by medians (along the longest side, as a kd-tree is built) into groups of equally many points, as
/// few as bring the product down to that, and the groups' means are assigned exactly; of each cloud fewer
/// points than one group are left over and left out.
///
/// Moving every point to the mean of its group costs the mean of the distances to it, so that by the triangle
/// inequality the result differs from the exact one of the points that take part by at most the mean of these
/// distances in the smaller cloud + the mean of as many of them in the larger, taken at their largest. That
/// is `error_bound_mm`, and a long way from what happens to clouds of the same density: that of a cloud and
/// its moved copy comes out exactly. Of clouds that differ much in density, groups of as many points differ
/// in size, and the bound is to be taken seriously.
EarthMovers earth_movers(std::span<const Eigen::Vector3f> a, std::span<const Eigen::Vector3f> b,
                         size_t exact_points);

}  // namespace gantry::internal
