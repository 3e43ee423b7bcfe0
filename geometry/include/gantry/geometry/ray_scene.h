#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "gantry/geometry/closest_on_triangle.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// Ray casting and closest-point queries against a triangle mesh, by Embree. Immutable after
/// construction; all queries are thread-safe. Coordinates are in the mesh's frame, mm.
class RayScene {
 public:
  struct Hit {
    float distance;  ///< Along the ray, in multiples of the direction's length.
    int triangle;
    float u, v;  ///< Barycentric weights of the triangle's second and third vertex.
  };

  using Feature = TriangleFeature;

  struct Closest {
    Eigen::Vector3f point;
    float distance;
    int triangle;
    Feature feature;
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

  /// The closest point of the mesh within `max_distance`; exact, with the feature it lies on.
  std::optional<Closest> closest(const Eigen::Vector3f& point, float max_distance) const;
  /// The same among triangles whose normal n has n . direction >= min_cosine: what keeps the two faces
  /// of a thin wall apart.
  std::optional<Closest> closest_facing(const Eigen::Vector3f& point, float max_distance,
                                        const Eigen::Vector3f& direction, float min_cosine) const;

  const TriangleMesh& mesh() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
