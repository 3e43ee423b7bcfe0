#include "joint/edge_matches.h"

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

constexpr float kSameNormal = 0.866f, kSameDirection = 0.9f;  // 30 and 25 degrees
/// By how much (rad^2) pixels tilt the direction across an edge, the mean of two; see PairSum::tilts.
constexpr double kTiltVariance = 0.5 * 0.05 * 0.05;

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

PairSum match_edges(const RangeSurface& target, const EdgeIndex& target_edges, const RangeSurface& source,
                    const Pose& target_from_source, const Pose& part_from_target,
                    const Eigen::Vector3d& centre, const EdgeGates& gates, std::vector<BlockSum>* blocks) {
  constexpr size_t kBlock = 16;
  const Eigen::Matrix3f rotation = target_from_source.linear().cast<float>();
  const Eigen::Vector3f shift = target_from_source.translation().cast<float>();
  const double radius_px = gates.reach_mm / target.spacing_mm + 1;
  const double scale_squared = gates.scale_mm * gates.scale_mm;
  PairSum sum, block;
  Eigen::Vector3d place = Eigen::Vector3d::Zero();
  size_t in_block = 0;
  const auto close_block = [&] {
    if (in_block == 0) return;
    sum += block;
    if (blocks)
      blocks->push_back({(place / static_cast<double>(in_block)).cast<float>(), block.gradient.cast<float>(),
                         (block.hessian - block.tilts).cast<float>()});
    block = {};
    place.setZero();
    in_block = 0;
  };
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
    const double loss = scale_squared / (scale_squared + residual * residual);
    const Eigen::Vector3d at = part_from_target * p.cast<double>(), arm = at - centre;
    const Eigen::Vector3d direction = part_from_target.linear() * across.cast<double>();
    const double weight = loss * loss;
    block.add(arm, direction, residual, weight);
    block.cost += loss * residual * residual;
    Eigen::Matrix<double, 6, 3> all;
    all << cross_matrix(arm), Eigen::Matrix3d::Identity();
    Vector6d a;
    a << arm.cross(direction), direction;
    block.directions += weight * a;
    block.tilts += kTiltVariance * weight * (all * all.transpose() - a * a.transpose());
    place += at;
    if (++in_block == kBlock) close_block();
  }
  close_block();
  return sum;
}

}  // namespace gantry::internal
