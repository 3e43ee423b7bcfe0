#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "gantry/geometry/ray_scene.h"

namespace gantry {

/// Signed distance to a triangle mesh: positive outside the material, negative inside. The sign is
/// taken from the angle-weighted pseudonormal of the closest feature (Baerentzen and Aanaes, "Signed
/// distance computation using the angle weighted pseudonormal", 2005), which is right at edges and
/// vertices, where the sign of the face normal is not. Edges and vertices are identified by position,
/// so that a mesh with split vertices serves as well. Thread-safe after construction.
class SignedDistance {
 public:
  struct Value {
    float distance;           ///< mm, positive outside.
    Eigen::Vector3f closest;  ///< The closest point of the mesh.
    Eigen::Vector3f normal;   ///< Unit pseudonormal of the closest feature.
    int triangle;
  };

  explicit SignedDistance(TriangleMesh mesh);

  /// Nothing when no surface lies within `max_distance`.
  std::optional<Value> operator()(const Eigen::Vector3f& point, float max_distance) const;
  /// The same, considering only faces whose normal is within acos(min_cosine) of the point's own
  /// normal: a wall bent by more than half its thickness is still measured to its own face. The sign
  /// comes from the full pseudonormal of the closest facing feature. It is exact where that feature is the
  /// closest of all; with a gate narrower than 90 degrees it can be wrong beside an edge.
  std::optional<Value> operator()(const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                                  float min_cosine, float max_distance) const;

  const RayScene& scene() const { return scene_; }

 private:
  Value signed_value(const Eigen::Vector3f& point, const RayScene::Closest& closest) const;

  RayScene scene_;
  std::vector<Eigen::Vector3f> vertex_normals_;               ///< Per vertex.
  std::vector<std::array<Eigen::Vector3f, 3>> edge_normals_;  ///< Per triangle: edges 01, 12, 20.
};

}  // namespace gantry
