#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// Ray casting against a triangle mesh, by Embree. Immutable after construction; all queries are thread-safe.
/// Coordinates are in the mesh's frame, mm.
class RayScene {
 public:
  struct Hit {
    float distance;  ///< Along the ray, in multiples of the direction's length.
    int triangle;
    float u, v;  ///< Barycentric weights of the triangle's second and third vertex.
  };

  /// Throws InputError for an empty mesh.
  explicit RayScene(TriangleMesh mesh);
  ~RayScene();
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;

  /// First surface hit by the ray, either side of a triangle.
  std::optional<Hit> cast(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                          float max_distance = 1e6f) const;
  /// Whether anything lies on the segment strictly between its ends.
  bool occluded(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const;

  const TriangleMesh& mesh() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
