#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "gantry/geometry/closest_on_triangle.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// Closest points on a fixed triangle mesh: a bounding volume hierarchy of our own, because Embree's point
/// query calls back for every triangle. Triangles are looked at eight at a time in float; those that could be
/// the closest are measured in double, so that the answer is exact to rounding, with the feature it lies on.
/// Triangles without area are left out. Immutable after construction; all queries are thread-safe.
/// Coordinates are in the mesh's frame, mm.
class SurfaceIndex {
 public:
  struct Closest {
    Eigen::Vector3f point;
    float distance;
    int triangle;  ///< Of equally close ones the first.
    TriangleFeature feature;
    Eigen::Vector3f offset;  ///< From there to the point asked about, to more digits than their difference.
  };

  /// Throws InputError for a mesh without a triangle that has an area.
  explicit SurfaceIndex(TriangleMesh mesh);
  ~SurfaceIndex();
  SurfaceIndex(SurfaceIndex&&) noexcept;
  SurfaceIndex& operator=(SurfaceIndex&&) noexcept;

  /// The closest point of the mesh within `max_distance`. `near_triangle`, if not negative, is a guess of the
  /// closest triangle, such as that of a neighbouring point: it changes the time, never the answer.
  std::optional<Closest> closest(const Eigen::Vector3f& point, float max_distance,
                                 int near_triangle = -1) const;
  /// The same among triangles whose normal n has n . direction >= min_cosine: what keeps the two faces
  /// of a thin wall apart.
  std::optional<Closest> closest_facing(const Eigen::Vector3f& point, float max_distance,
                                        const Eigen::Vector3f& direction, float min_cosine,
                                        int near_triangle = -1) const;

  const TriangleMesh& mesh() const;
  /// Unit normals of the triangles, zero for those without area.
  const std::vector<Eigen::Vector3f>& normals() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
