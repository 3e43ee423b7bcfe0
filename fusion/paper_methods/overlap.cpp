#include "gantry/fusion/overlap.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

/// Points looked at per scan: many for each cell that is worth counting.
constexpr size_t kPoints = 50000;

}  // namespace

OccupiedCells::OccupiedCells(const ScanSurface& surface, const Pose& part_from_sensor, double cell_mm) {
  if (!(cell_mm > 0) || !std::isfinite(cell_mm))
    throw InputError("overlap: cell_mm must be positive, found " + std::to_string(cell_mm));
  const size_t stride = std::max<size_t>(1, surface.cloud.size() / kPoints);
  for (size_t i = 0; i < surface.cloud.size(); i += stride) {
    const Eigen::Vector3d p = part_from_sensor * surface.cloud.points[i].cast<double>() / cell_mm;
    const Eigen::Vector3d n = part_from_sensor.linear() * surface.cloud.normals[i].cast<double>();
    Eigen::Index axis;
    n.cwiseAbs().maxCoeff(&axis);
    uint64_t key = static_cast<uint64_t>(2 * axis + (n[axis] < 0));
    for (int k = 0; k < 3; ++k) {
      const auto coordinate = static_cast<int64_t>(std::floor(p[k])) + (1 << 19);
      key = key << 20 | (static_cast<uint64_t>(coordinate) & 0xFFFFF);
    }
    keys_.push_back(key);
  }
  std::sort(keys_.begin(), keys_.end());
  keys_.erase(std::unique(keys_.begin(), keys_.end()), keys_.end());
}

double OccupiedCells::overlap(const OccupiedCells& other) const {
  size_t common = 0;
  for (auto i = keys_.begin(), j = other.keys_.begin(); i != keys_.end() && j != other.keys_.end();) {
    common += *i == *j;
    const bool advance_i = *i <= *j, advance_j = *j <= *i;
    i += advance_i;
    j += advance_j;
  }
  const size_t smaller = std::max<size_t>(1, std::min(keys_.size(), other.keys_.size()));
  return static_cast<double>(common) / static_cast<double>(smaller);
}

double predicted_overlap(const ScanSurface& a, const ScanSurface& b, double cell_mm) {
  return OccupiedCells(a, a.part_from_sensor.mean, cell_mm)
      .overlap(OccupiedCells(b, b.part_from_sensor.mean, cell_mm));
}

std::vector<OverlappingPair> overlapping_pairs(std::span<const ScanSurface> surfaces,
                                               std::span<const Pose> part_from_sensor, double cell_mm,
                                               double min_overlap) {
  std::vector<std::optional<OccupiedCells>> cells(surfaces.size());
  tbb::parallel_for(size_t{0}, surfaces.size(),
                    [&](size_t i) { cells[i].emplace(surfaces[i], part_from_sensor[i], cell_mm); });
  std::vector<OverlappingPair> pairs;
  for (size_t source = 1; source < surfaces.size(); ++source)
    for (size_t target = 0; target < source; ++target) {
      const double overlap = cells[target]->overlap(*cells[source]);
      if (overlap >= min_overlap) pairs.push_back({target, source, overlap, false});
    }

  // Kruskal: the greatest overlaps first, each that joins two groups.
  std::vector<size_t> group(surfaces.size()), order(pairs.size());
  std::iota(group.begin(), group.end(), size_t{0});
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return pairs[a].overlap > pairs[b].overlap; });
  for (const size_t k : order) {
    const size_t from = group[pairs[k].source], to = group[pairs[k].target];
    if (from == to) continue;
    pairs[k].neighbours = true;
    std::replace(group.begin(), group.end(), from, to);
  }
  return pairs;
}

}  // namespace gantry
