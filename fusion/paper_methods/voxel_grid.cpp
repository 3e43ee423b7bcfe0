#include "gantry/fusion/voxel_grid.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr int kCellBits = 20;  // of each coordinate; the rest of 64 bits tells the direction of the normal

struct Entry {
  uint64_t key;
  uint32_t point;
};

std::vector<Entry> sorted_entries(const PointCloud& cloud, double voxel_mm) {
  Eigen::AlignedBox3f box;
  for (const auto& p : cloud.points) box.extend(p);
  if (box.sizes().maxCoeff() / voxel_mm >= (1 << kCellBits) - 1)
    throw InputError("voxel_size_mm: " + std::to_string(voxel_mm) + " is too small for a scan of " +
                     std::to_string(box.sizes().maxCoeff()) + " mm");
  std::vector<Entry> entries(cloud.size());
  for (uint32_t i = 0; i < cloud.size(); ++i) {
    Eigen::Index axis;
    cloud.normals[i].cwiseAbs().maxCoeff(&axis);
    uint64_t key = static_cast<uint64_t>(2 * axis + (cloud.normals[i][axis] < 0));
    for (int k = 0; k < 3; ++k)
      key = key << kCellBits |
            static_cast<uint64_t>(static_cast<double>(cloud.points[i][k] - box.min()[k]) / voxel_mm);
    entries[i] = {key, i};
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return a.key != b.key ? a.key < b.key : a.point < b.point;
  });
  return entries;
}

}  // namespace

ScanSurface voxel_downsample(const ScanSurface& surface, double voxel_mm) {
  if (!(voxel_mm > 0) || !std::isfinite(voxel_mm))
    throw InputError("voxel_size_mm: must be a positive length, found " + std::to_string(voxel_mm));
  ScanSurface out;
  out.name = surface.name;
  out.part_from_sensor = surface.part_from_sensor;
  out.measured = surface.measured;
  out.dropped_crop = surface.dropped_crop;
  out.dropped_edges = surface.dropped_edges;
  out.spacing_mm = std::max(voxel_mm, surface.spacing_mm);

  const PointCloud& cloud = surface.cloud;
  const std::vector<Entry> entries = sorted_entries(cloud, voxel_mm);
  for (size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
    Eigen::Vector3d point = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::Zero();
    double weights = 0;
    size_t on_rim = 0;
    for (end = begin; end < entries.size() && entries[end].key == entries[begin].key; ++end) {
      const uint32_t i = entries[end].point;
      const double weight = 1.0 / (static_cast<double>(cloud.sigma_mm[i]) * cloud.sigma_mm[i]);
      point += weight * cloud.points[i].cast<double>();
      normal += weight * cloud.normals[i].cast<double>();
      weights += weight;
      on_rim += surface.rim[i] != 0;
    }
    if (!(normal.norm() > 0.1 * weights)) continue;
    out.cloud.points.push_back((point / weights).cast<float>());
    out.cloud.normals.push_back(normal.normalized().cast<float>());
    out.cloud.sigma_mm.push_back(static_cast<float>(1.0 / std::sqrt(weights)));
    out.rim.push_back(2 * on_rim > end - begin);
  }
  std::vector<float> sigmas = out.cloud.sigma_mm;
  if (!sigmas.empty()) {
    const auto middle = sigmas.begin() + static_cast<std::ptrdiff_t>(sigmas.size() / 2);
    std::nth_element(sigmas.begin(), middle, sigmas.end());
    out.noise_mm = *middle;
  }
  return out;
}

}  // namespace gantry
