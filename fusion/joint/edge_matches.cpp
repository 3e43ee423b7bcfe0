#include "joint/edge_matches.h"

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

constexpr float kSameNormal = 0.866f, kSameDirection = 0.9f;  // 30 and 25 degrees
/// By how much (rad^2) pixels tilt the direction across an edge, the mean of two; see PairSum::tilts.
constexpr double kTiltVariance = 0.5 * 0.05 * 0.05;

/// How far a face's normal may lie from the direction in which the side ends.
constexpr float kAtFace = 0.95f;
/// The face is looked at beyond the windows that reach over the edge, by so many pixels, ...
constexpr int kBeyondWindow_px = 2;
/// ... and must begin within so many.
constexpr double kNearEdge_px = 12;

void add(EdgeSums& sums, const Eigen::Vector3d& arm, const Eigen::Vector3d& direction, double residual,
         double scale_squared, double tilt_variance) {
  Eigen::Index axis = 0;
  direction.cwiseAbs().maxCoeff(&axis);
  PairSum& sum = sums[static_cast<size_t>(2 * axis + (direction[axis] > 0 ? 1 : 0))];
  const double loss = scale_squared / (scale_squared + residual * residual), weight = loss * loss;
  sum.add(arm, direction, residual, weight, tilt_variance);
  sum.cost += weight * residual * residual;
  sum.offset += weight * residual;
  sum.directions.head<3>() += weight * arm.cross(direction);
  sum.directions.tail<3>() += weight * direction;
}

}  // namespace

EdgeIndex::EdgeIndex(const RangeSurface& s)
    : across_((s.width + kTile_px - 1) / kTile_px), down_((s.height + kTile_px - 1) / kTile_px) {
  std::vector<size_t> tile_of;
  first_.assign(static_cast<size_t>(across_) * down_ + 1, 0);
  for (const SurfaceEdge& edge : s.edges) {
    const Eigen::Vector2d pixel = s.rays.pixel(s.rays.ray_of(edge.point.cast<double>()));
    const int column = std::clamp(static_cast<int>(pixel.x()) / kTile_px, 0, across_ - 1),
              row = std::clamp(static_cast<int>(pixel.y()) / kTile_px, 0, down_ - 1);
    tile_of.push_back(static_cast<size_t>(row) * across_ + column);
    ++first_[tile_of.back() + 1];
  }
  for (size_t t = 1; t < first_.size(); ++t) first_[t] += first_[t - 1];
  edges_.resize(s.edges.size());
  std::vector<size_t> next(first_.begin(), first_.end() - 1);
  for (size_t k = 0; k < s.edges.size(); ++k) edges_[next[tile_of[k]]++] = s.edges[k];
}

EdgeSums match_edges(const RangeSurface& target, const EdgeIndex& target_edges, const RangeSurface& source,
                     const Pose& target_from_source, const Pose& part_from_target,
                     const Eigen::Vector3d& centre, const EdgeGates& gates) {
  const Eigen::Matrix3f rotation = target_from_source.linear().cast<float>();
  const Eigen::Vector3f shift = target_from_source.translation().cast<float>();
  const double radius_px = gates.reach_mm / target.spacing_mm + 1;
  const double scale_squared = gates.scale_mm * gates.scale_mm;
  EdgeSums sums;
  for (size_t k = 0; k < source.edges.size(); k += gates.step) {
    const SurfaceEdge& edge = source.edges[k];
    const Eigen::Vector3f p = rotation * edge.point + shift, n = rotation * edge.normal,
                          out = rotation * edge.outwards;
    if (target.rays.central && p.z() <= 1) continue;
    const SurfaceEdge* nearest = nullptr;
    auto least = static_cast<float>(gates.reach_mm * gates.reach_mm);
    target_edges.near(
        target.rays.pixel(target.rays.ray_of(p.cast<double>())), radius_px, [&](const SurfaceEdge& other) {
          const float d = (p - other.point).squaredNorm();
          if (d < least && n.dot(other.normal) > kSameNormal && out.dot(other.outwards) > kSameDirection) {
            least = d;
            nearest = &other;
          }
        });
    if (!nearest) continue;
    const Eigen::Vector3f across = (out + nearest->outwards).normalized();
    const double residual = across.dot(p - nearest->point);
    const Eigen::Vector3d at = part_from_target * p.cast<double>();
    add(sums, at - centre, part_from_target.linear() * across.cast<double>(), residual, scale_squared,
        kTiltVariance);
  }
  return sums;
}

EdgeSums match_edges_to_faces(const RangeSurface& target, const RangeSurface& source,
                              const Pose& target_from_source, const Pose& part_from_target,
                              const Eigen::Vector3d& centre, const EdgeGates& gates) {
  const Eigen::Matrix3f rotation = target_from_source.linear().cast<float>();
  const Eigen::Vector3f shift = target_from_source.translation().cast<float>();
  const auto inside_mm = static_cast<float>((target.normal_window_px + kBeyondWindow_px) * target.spacing_mm);
  const auto far_mm = static_cast<float>(kNearEdge_px * target.spacing_mm + gates.reach_mm);
  const double scale_squared = gates.scale_mm * gates.scale_mm;
  EdgeSums sums;
  for (size_t k = 0; k < source.edges.size(); k += gates.step) {
    const SurfaceEdge& edge = source.edges[k];
    const Eigen::Vector3f p = rotation * edge.point + shift, n = rotation * edge.normal,
                          out = rotation * edge.outwards;
    const Eigen::Vector3f inside = p - inside_mm * n;
    if (target.rays.central && inside.z() <= 1) continue;
    const Eigen::Vector2d pixel = target.rays.pixel(target.rays.ray_of(inside.cast<double>()));
    // NaN fails this too.
    if (!(pixel.x() > -0.5 && pixel.y() > -0.5 && pixel.x() < target.width - 0.5 &&
          pixel.y() < target.height - 0.5))
      continue;
    const int column = static_cast<int>(std::lround(pixel.x())),
              row = static_cast<int>(std::lround(pixel.y()));
    const size_t j = target.index(column, row);
    if (target.w[j] == 0) continue;
    const Eigen::Vector3f face = unpack_normal(target.normals[j]);
    if (face.dot(out) < kAtFace) continue;
    const Eigen::Vector3f apart = p - target.point(column, row).cast<float>();
    const double residual = face.dot(apart) + gates.break_mm;
    if (apart.norm() > far_mm || std::abs(residual) > gates.reach_mm) continue;
    const Eigen::Vector3d at = part_from_target * p.cast<double>();
    add(sums, at - centre, part_from_target.linear() * face.cast<double>(), residual, scale_squared,
        gates.normal_variance);
  }
  return sums;
}

}  // namespace gantry::internal
