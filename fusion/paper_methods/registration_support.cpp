#include "paper_methods/registration_support.h"

#include <algorithm>

namespace gantry {
namespace {

/// Cells of the overlap grid: not finer than this many point spacings, nor coarser than this share of the
/// scans' extent.
constexpr double kCellInSpacings = 10;
constexpr double kCellInExtents = 0.2;

double extent_mm(const ScanSurface& surface) {
  Eigen::AlignedBox3f box;
  for (const auto& p : surface.cloud.points) box.extend(p);
  return surface.cloud.points.empty() ? 0 : box.diagonal().norm();
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Eigen::Vector3d centroid(const ScanSurface& surface) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& p : surface.cloud.points) sum += p.cast<double>();
  return sum / static_cast<double>(std::max<size_t>(1, surface.cloud.size()));
}

double relative_sigma_mm(const ScanSurface& a, const ScanSurface& b) {
  const Eigen::Vector3d centre =
      0.5 * (a.part_from_sensor.mean * centroid(a) + b.part_from_sensor.mean * centroid(b));
  return point_sigma_mm(a.part_from_sensor.covariance() + b.part_from_sensor.covariance(), centre);
}

std::vector<OverlappingPair> pairs_at_tags(std::span<const ScanSurface> surfaces, double min_overlap) {
  if (surfaces.size() < 2) return {};
  std::vector<double> sigmas, spacings, extents;
  std::vector<Pose> poses;
  for (const ScanSurface& s : surfaces) {
    sigmas.push_back(relative_sigma_mm(surfaces[0], s));
    spacings.push_back(s.spacing_mm);
    extents.push_back(extent_mm(s));
    poses.push_back(s.part_from_sensor.mean);
  }
  const double cell_mm = std::max(kCellInSpacings * median(spacings),
                                  std::min(3 * median(sigmas), kCellInExtents * median(extents)));
  return overlapping_pairs(surfaces, poses, cell_mm, min_overlap);
}

double start_radius_mm(const ScanSurface& a, const ScanSurface& b) {
  return std::min(3 * relative_sigma_mm(a, b), std::min(extent_mm(a), extent_mm(b)) / 6);
}

std::string unconnected_scans(std::span<const ScanSurface> surfaces, const std::vector<PairReport>& pairs) {
  std::vector<bool> reached(surfaces.size(), false);
  if (!reached.empty()) reached[0] = true;
  for (bool grew = true; grew;) {
    grew = false;
    for (const PairReport& pair : pairs) {
      if (!pair.kept || reached[pair.target] == reached[pair.source]) continue;
      reached[pair.target] = reached[pair.source] = true;
      grew = true;
    }
  }
  std::string lost;
  for (size_t i = 0; i < surfaces.size(); ++i)
    if (!reached[i]) lost += (lost.empty() ? "" : ", ") + surfaces[i].name;
  return lost.empty() ? lost : "not connected to the first scan by any usable overlap: " + lost;
}

}  // namespace gantry
