#include "distances/sorted_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

#include "gantry/foundation/error.h"

namespace gantry::internal {
namespace {

/// Moves the lowest 21 bits apart, two zeros between any two.
uint64_t spread(uint64_t x) {
  x = (x | x << 32) & 0x001f00000000ffff;
  x = (x | x << 16) & 0x001f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  return (x | x << 2) & 0x1249249249249249;
}

}  // namespace

std::vector<uint32_t> morton_order(std::span<const Eigen::Vector3f> points) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& p : points) box.extend(p.cast<double>());
  const double longest = box.sizes().maxCoeff();
  const double cells = longest > 0 ? ((1 << 21) - 1) / longest : 0;
  std::vector<std::pair<uint64_t, uint32_t>> codes(points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d at = (points[i].cast<double>() - box.min()) * cells;
    uint64_t code = 0;
    for (int axis = 0; axis < 3; ++axis) code |= spread(static_cast<uint64_t>(at[axis])) << axis;
    codes[i] = {code, static_cast<uint32_t>(i)};
  }
  std::sort(codes.begin(), codes.end());
  std::vector<uint32_t> order(points.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = codes[i].second;
  return order;
}

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
