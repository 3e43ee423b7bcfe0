#include "gantry/geometry/point_cloud.h"

namespace gantry {
namespace {

std::shared_ptr<const CloudSources> select(const CloudSources& all, std::span<const uint32_t> which) {
  auto some = std::make_shared<CloudSources>();
  some->scans = all.scans;
  some->pose_covariance = all.pose_covariance;
  some->doubt = all.doubt;
  some->first.reserve(which.size() + 1);
  some->first.push_back(0);
  for (const uint32_t i : which) {
    const auto shares = all.of(i);
    some->shares.insert(some->shares.end(), shares.begin(), shares.end());
    some->first.push_back(static_cast<uint32_t>(some->shares.size()));
  }
  return some;
}

}  // namespace

PointCloud select(const PointCloud& cloud, std::span<const uint32_t> which) {
  PointCloud some;
  some.points.reserve(which.size());
  for (const uint32_t i : which) {
    some.points.push_back(cloud.points[i]);
    if (cloud.has_normals()) some.normals.push_back(cloud.normals[i]);
    if (cloud.has_sigma()) some.sigma_mm.push_back(cloud.sigma_mm[i]);
  }
  if (cloud.sources) some.sources = select(*cloud.sources, which);
  return some;
}

}  // namespace gantry
