#include "distances/sorted_points.h"

#include <limits>

#include "gantry/foundation/error.h"
#include "gantry/geometry/spatial_order.h"

namespace gantry::internal {

PointCloud morton_sorted(const PointCloud& cloud) {
  PointCloud sorted;
  sorted.points.reserve(cloud.size());
  for (const uint32_t i : morton_order(cloud.points)) {
    sorted.points.push_back(cloud.points[i]);
    if (cloud.has_normals()) sorted.normals.push_back(cloud.normals[i]);
  }
  return sorted;
}

void require_points(const PointCloud& cloud, const std::string& name) {
  if (cloud.points.empty()) throw InputError(name + " holds no points");
  if (cloud.size() > std::numeric_limits<uint32_t>::max()) throw InputError(name + " holds too many points");
  for (size_t i = 0; i < cloud.size(); ++i)
    if (!cloud.points[i].allFinite())
      throw InputError(name + ": point " + std::to_string(i) +
                       " has a coordinate that is not a finite number");
}

}  // namespace gantry::internal
