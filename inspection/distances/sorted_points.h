#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "gantry/geometry/point_cloud.h"

namespace gantry::internal {

/// The order of points along a Morton curve: neighbours in it are neighbours in space. Searching in a cloud
/// that is stored and queried in such an order is several times as fast as in any order, for the cache's
/// sake.
std::vector<uint32_t> morton_order(std::span<const Eigen::Vector3f> points);

/// The cloud (points, and normals when it has them) in that order; sigma is not kept.
PointCloud morton_sorted(const PointCloud& cloud);

/// Throws InputError naming the cloud by `name` when it has no points or one that is not finite.
void require_points(const PointCloud& cloud, const std::string& name);

}  // namespace gantry::internal
