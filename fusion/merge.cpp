#include "gantry/fusion/merge.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

struct Entry {
  uint64_t cell;
  uint32_t scan, point;
  bool operator<(const Entry& o) const {
    return std::tie(cell, scan, point) < std::tie(o.cell, o.scan, o.point);
  }
};

}  // namespace

PointCloud merge_surfaces(const std::vector<ScanSurface>& surfaces, const std::vector<Pose>& part_from_sensor,
                          const MergeOptions& options, double* voxel_used_mm) {
  double voxel_mm = options.voxel_mm;
  if (voxel_mm <= 0) {
    std::vector<double> spacings;
    for (const auto& s : surfaces) spacings.push_back(s.spacing_mm);
    std::nth_element(spacings.begin(), spacings.begin() + static_cast<std::ptrdiff_t>(spacings.size() / 2),
                     spacings.end());
    voxel_mm = 1.1 * spacings[spacings.size() / 2];
  }
  if (voxel_used_mm) *voxel_used_mm = voxel_mm;

  std::vector<size_t> offset(surfaces.size() + 1, 0);
  for (size_t s = 0; s < surfaces.size(); ++s) offset[s + 1] = offset[s] + surfaces[s].cloud.size();
  std::vector<Entry> entries(offset.back());
  for (size_t s = 0; s < surfaces.size(); ++s) {
    const Pose& pose = part_from_sensor[s];
    const PointCloud& cloud = surfaces[s].cloud;
    tbb::parallel_for(size_t{0}, cloud.size(), [&](size_t i) {
      const Eigen::Vector3d p = pose * cloud.points[i].cast<double>() / voxel_mm;
      const Eigen::Vector3d n = pose.linear() * cloud.normals[i].cast<double>();
      Eigen::Index axis;
      n.cwiseAbs().maxCoeff(&axis);
      uint64_t key = static_cast<uint64_t>(2 * axis + (n[axis] < 0));
      for (int k = 0; k < 3; ++k)
        key =
            key << 20 | (static_cast<uint64_t>(static_cast<int64_t>(std::floor(p[k])) + (1 << 19)) & 0xFFFFF);
      entries[offset[s] + i] = {key, static_cast<uint32_t>(s), static_cast<uint32_t>(i)};
    });
  }
  tbb::parallel_sort(entries.begin(), entries.end());

  // The occupied cells: where each begins in `entries`.
  std::vector<size_t> begins;
  for (size_t i = 0; i < entries.size(); ++i)
    if (i == 0 || entries[i].cell != entries[i - 1].cell) begins.push_back(i);
  begins.push_back(entries.size());
  const size_t cells = begins.size() - 1;
  const auto measurements_in = [&](uint64_t cell) -> size_t {
    const auto found =
        std::lower_bound(begins.begin(), begins.end() - 1, cell,
                         [&](size_t begin, uint64_t key) { return entries[begin].cell < key; });
    return found != begins.end() - 1 && entries[*found].cell == cell ? *(found + 1) - *found : 0;
  };
  std::vector<unsigned char> supported(cells, 0);
  tbb::parallel_for(size_t{0}, cells, [&](size_t c) {
    const uint64_t cell = entries[begins[c]].cell;
    size_t support = begins[c + 1] - begins[c];
    for (int64_t dx = -1; dx <= 1 && support < options.min_support; ++dx)
      for (int64_t dy = -1; dy <= 1; ++dy)
        for (int64_t dz = -1; dz <= 1; ++dz)
          if (dx != 0 || dy != 0 || dz != 0)
            support += measurements_in(
                cell + static_cast<uint64_t>((dx * (int64_t{1} << 40)) + (dy * (1 << 20)) + dz));
    supported[c] = support >= options.min_support;
  });

  PointCloud merged;
  for (size_t c = 0; c < cells; ++c) {
    if (!supported[c]) continue;
    Eigen::Vector3d point = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::Zero();
    double weight = 0;
    for (size_t e = begins[c]; e < begins[c + 1]; ++e) {
      const PointCloud& cloud = surfaces[entries[e].scan].cloud;
      const Pose& pose = part_from_sensor[entries[e].scan];
      const double sigma = cloud.sigma_mm[entries[e].point];
      const double w = 1.0 / (sigma * sigma);
      point += w * (pose * cloud.points[entries[e].point].cast<double>());
      normal += w * (pose.linear() * cloud.normals[entries[e].point].cast<double>());
      weight += w;
    }
    merged.points.push_back((point / weight).cast<float>());
    merged.normals.push_back(normal.stableNormalized().cast<float>());
    merged.sigma_mm.push_back(static_cast<float>(1.0 / std::sqrt(weight)));
  }
  return merged;
}

}  // namespace gantry
