#include "distances/m3c2.h"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

#include "distances/statistics.h"
#include "gantry/foundation/error.h"

namespace gantry {

double level_of_detection_95(double s1_mm, size_t n1, double s2_mm, size_t n2, double registration_mm) {
  return 1.96 *
         (std::sqrt(s1_mm * s1_mm / static_cast<double>(n1) + s2_mm * s2_mm / static_cast<double>(n2)) +
          registration_mm);
}

namespace internal {
namespace {

constexpr size_t kLeastPoints = 4;
constexpr float kAnywhere = 1e15f;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

using Neighbours = std::vector<PointIndex::Neighbour>;

/// Median distance of a point to its nearest neighbour, over up to 5000 points spread evenly.
double spacing_of(const PointCloud& cloud, const PointIndex& index) {
  std::vector<float> distances;
  Neighbours two;
  for (size_t i = 0; i < cloud.size(); i += std::max<size_t>(1, cloud.size() / 5000)) {
    index.nearest(cloud.points[i], 2, kAnywhere, two);
    if (two.size() == 2) distances.push_back(std::sqrt(two[1].squared_distance));
  }
  std::sort(distances.begin(), distances.end());
  return distances.empty() ? 0 : percentile(distances, 50);
}

struct Scales {
  double normal_mm, cylinder_mm, depth_mm;
};

Scales chosen_scales(const PointCloud& a, const PointIndex& a_index, const PointCloud& b,
                     const PointIndex& b_index, std::span<const PointIndex::Neighbour> nearest,
                     const DistanceOptions& options) {
  const double spacing = std::max(spacing_of(a, a_index), spacing_of(b, b_index));
  const auto given_or = [](double given, double chosen) { return given > 0 ? given : chosen; };
  Scales scales{};
  scales.cylinder_mm = given_or(options.m3c2_cylinder_diameter_mm, 10 * spacing);
  scales.normal_mm = given_or(options.m3c2_normal_diameter_mm, 20 * spacing);
  std::vector<float> distances;
  for (const auto& n : nearest) distances.push_back(std::sqrt(n.squared_distance));
  std::sort(distances.begin(), distances.end());
  scales.depth_mm = given_or(options.m3c2_depth_mm, scales.cylinder_mm + percentile(distances, 99));
  if (!(scales.cylinder_mm > 0 && scales.normal_mm > 0))
    throw InputError("m3c2: its scales cannot be chosen, most points coincide; give them");
  return scales;
}

std::optional<Eigen::Vector3d> normal_at(const PointCloud& cloud, const Neighbours& around) {
  if (around.size() < kLeastPoints) return std::nullopt;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& n : around) mean += cloud.points[n.index].cast<double>();
  mean /= static_cast<double>(around.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& n : around) {
    const Eigen::Vector3d d = cloud.points[n.index].cast<double>() - mean;
    scatter += d * d.transpose();
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors().col(0);
}

/// Positions of a cloud's points along the axis of a cylinder.
struct Positions {
  size_t count = 0;
  double mean_mm = 0, sigma_mm = 0;
};

Positions positions_in_cylinder(const PointCloud& cloud, const PointIndex& index, const Eigen::Vector3d& core,
                                const Eigen::Vector3d& axis, const Scales& scales) {
  // The cylinder in slices as high as wide at most, each within a ball: a ball around the whole of a long
  // cylinder would hold mostly other points.
  const auto slices = static_cast<int>(std::ceil(2 * scales.depth_mm / scales.cylinder_mm));
  const double height = 2 * scales.depth_mm / slices, radius = scales.cylinder_mm / 2;
  const double ball = 1.001 * std::hypot(radius, height / 2);
  thread_local Neighbours near;
  thread_local std::vector<double> along;
  along.clear();
  for (int slice = 0; slice < slices; ++slice) {
    const double low = -scales.depth_mm + slice * height, high = low + height;
    index.within((core + (low + height / 2) * axis).cast<float>(), static_cast<float>(ball), near);
    for (const auto& n : near) {
      const Eigen::Vector3d d = cloud.points[n.index].cast<double>() - core;
      const double t = d.dot(axis);
      if (t >= low && t < high && (d - t * axis).squaredNorm() <= radius * radius) along.push_back(t);
    }
  }
  Positions positions;
  positions.count = along.size();
  if (along.size() < 2) return positions;
  for (const double t : along) positions.mean_mm += t / static_cast<double>(along.size());
  double squares = 0;
  for (const double t : along) squares += (t - positions.mean_mm) * (t - positions.mean_mm);
  positions.sigma_mm = std::sqrt(squares / static_cast<double>(along.size() - 1));
  return positions;
}

}  // namespace

M3c2 m3c2(const PointCloud& a, const PointIndex& a_index, const PointCloud& b, const PointIndex& b_index,
          std::span<const PointIndex::Neighbour> nearest, const DistanceOptions& options) {
  if (a.size() < kLeastPoints || b.size() < kLeastPoints)
    throw InputError("m3c2: both clouds need four points at least; they have " + std::to_string(a.size()) +
                     " and " + std::to_string(b.size()));
  const Scales scales = chosen_scales(a, a_index, b, b_index, nearest, options);
  M3c2 result;
  result.distance_mm.assign(a.size(), kNaN);
  result.lod95_mm.assign(a.size(), kNaN);
  tbb::parallel_for(size_t{0}, a.size(), [&](size_t i) {
    thread_local Neighbours around;
    a_index.within(a.points[i], static_cast<float>(scales.normal_mm / 2), around);
    auto normal = normal_at(a, around);
    if (!normal) return;
    Eigen::Vector3d outwards = Eigen::Vector3d::UnitZ();
    if (a.has_normals())
      outwards = a.normals[i].cast<double>();
    else if (b.has_normals())
      outwards = b.normals[nearest[i].index].cast<double>();
    if (normal->dot(outwards) < 0) *normal = -*normal;
    const Eigen::Vector3d core = a.points[i].cast<double>();
    const Positions in_a = positions_in_cylinder(a, a_index, core, *normal, scales);
    const Positions in_b = positions_in_cylinder(b, b_index, core, *normal, scales);
    if (in_a.count < kLeastPoints || in_b.count < kLeastPoints) return;
    result.distance_mm[i] = static_cast<float>(in_a.mean_mm - in_b.mean_mm);
    result.lod95_mm[i] = static_cast<float>(
        level_of_detection_95(in_a.sigma_mm, in_a.count, in_b.sigma_mm, in_b.count, options.registration_mm));
  });
  char text[160];
  std::snprintf(text, sizeof text, "normals at %.3g mm, cylinder %.3g mm wide, %.3g mm to either side",
                scales.normal_mm, scales.cylinder_mm, scales.depth_mm);
  result.note = text;
  if (!a.has_normals() && !b.has_normals()) result.note += "; without normals in A or B positive is up (+z)";
  return result;
}

}  // namespace internal
}  // namespace gantry
