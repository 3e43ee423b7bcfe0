#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "gantry/geometry/surface_index.h"

namespace gantry {
namespace internal {
class Pseudonormals;
}

/// Signed distance to a triangle mesh: positive outside the material, negative inside. The sign is
/// taken from the angle-weighted pseudonormal of the closest feature (Baerentzen and Aanaes, "Signed
/// distance computation using the angle weighted pseudonormal", 2005), which is right at edges and
/// vertices, where the sign of the face normal is not. Edges and vertices are identified by position,
/// so that a mesh with split vertices serves as well. Thread-safe after construction.
///
/// Of an open mesh the side of the nearest face decides; `at_border` tells where the surface ends and the
/// sign therefore means little. Where faces cancel each other (a sheet that is listed with both its sides, an
/// edge at which solids touch) the sign is positive. analyse_topology() tells beforehand what a mesh is like.
class SignedDistance {
 public:
  struct Value {
    float distance;           ///< mm, positive outside.
    Eigen::Vector3f closest;  ///< The closest point of the mesh.
    Eigen::Vector3f normal;   ///< Unit pseudonormal of the closest feature.
    int triangle;
    bool at_border;  ///< The closest point lies on the border of an open mesh.
  };

  /// Throws InputError for a mesh without a triangle that has an area.
  explicit SignedDistance(TriangleMesh mesh);
  ~SignedDistance();
  SignedDistance(SignedDistance&&) noexcept;
  SignedDistance& operator=(SignedDistance&&) noexcept;

  /// Nothing when no surface lies within `max_distance`. `hint`: see SurfaceIndex.
  std::optional<Value> operator()(const Eigen::Vector3f& point, float max_distance,
                                  SurfaceIndex::Hint hint = {}) const;
  /// The same, considering only faces whose normal is within acos(min_cosine) of the point's own
  /// normal: a wall bent by more than half its thickness is still measured to its own face. The sign
  /// comes from the full pseudonormal of the closest facing feature. It is exact where that feature is the
  /// closest of all; with a gate narrower than 90 degrees it can be wrong beside an edge.
  std::optional<Value> operator()(const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                                  float min_cosine, float max_distance, SurfaceIndex::Hint hint = {}) const;

  const TriangleMesh& mesh() const { return surface_.mesh(); }

 private:
  Value signed_value(const SurfaceIndex::Closest& closest) const;

  std::unique_ptr<internal::Pseudonormals> pseudonormals_;  // made while the index is: before it here
  SurfaceIndex surface_;
};

}  // namespace gantry
