#include "gantry/geometry/signed_distance.h"

#include "pseudonormals.h"

namespace gantry {

SignedDistance::SignedDistance(TriangleMesh mesh)
    : surface_(std::move(mesh), [this](const TriangleMesh& of, const std::vector<Eigen::Vector3f>& normals) {
        pseudonormals_ = std::make_unique<internal::Pseudonormals>(of, normals);
      }) {}

SignedDistance::~SignedDistance() = default;
SignedDistance::SignedDistance(SignedDistance&&) noexcept = default;
SignedDistance& SignedDistance::operator=(SignedDistance&&) noexcept = default;

SignedDistance::Value SignedDistance::signed_value(const SurfaceIndex::Closest& closest) const {
  const auto [normal, at_border] = pseudonormals_->of(closest.triangle, closest.feature);
  const bool inside = closest.offset.dot(normal) < 0;
  return {inside ? -closest.distance : closest.distance, closest.point, normal, closest.triangle, at_border};
}

std::optional<SignedDistance::Value> SignedDistance::operator()(const Eigen::Vector3f& point,
                                                                float max_distance,
                                                                SurfaceIndex::Hint hint) const {
  const auto closest = surface_.closest(point, max_distance, hint);
  if (!closest) return std::nullopt;
  return signed_value(*closest);
}

std::optional<SignedDistance::Value> SignedDistance::operator()(const Eigen::Vector3f& point,
                                                                const Eigen::Vector3f& normal,
                                                                float min_cosine, float max_distance,
                                                                SurfaceIndex::Hint hint) const {
  const auto closest = surface_.closest_facing(point, max_distance, normal, min_cosine, hint);
  if (!closest) return std::nullopt;
  return signed_value(*closest);
}

}  // namespace gantry
