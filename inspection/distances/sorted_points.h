#pragma once

#include <string>

#include "gantry/geometry/point_cloud.h"

namespace gantry::internal {

/// The cloud (points, and normals when it has them) in Morton order; sigma is not kept.
PointCloud morton_sorted(const PointCloud& cloud);

/// Throws InputError naming the cloud by `name` when it has no points or one that is not finite.
void require_points(const PointCloud& cloud, const std::string& name);

}  // namespace gantry::internal
