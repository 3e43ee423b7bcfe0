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
/// points than one group are left over and left out. Moving every point to the mean of its group costs the
/// mean distance to it, so that by the triangle inequality the result differs from the exact one of the
/// points that take part by at most (sum of these distances in A and in B) / number of points in the smaller
/// cloud. That is `error_bound_mm`; it is a long way from what happens: the distance of a cloud from its
/// moved copy, for example, is exact.
EarthMovers earth_movers(std::span<const Eigen::Vector3f> a, std::span<const Eigen::Vector3f> b,
                         size_t exact_points);

}  // namespace gantry::internal
