#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "gantry/geometry/closest_on_triangle.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry {
namespace internal {
class Surroundings;
}

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

  /// What a series of queries learns of the surface, each close to the one before: where the closest point
  /// was, and what lies about. For one thread; given to another index it starts anew.
  class Neighbourhood {
   public:
    Neighbourhood();
    ~Neighbourhood();
    Neighbourhood(const Neighbourhood&) = delete;
    Neighbourhood& operator=(const Neighbourhood&) = delete;

   private:
    friend class SurfaceIndex;
    std::unique_ptr<internal::Surroundings> surroundings_;
  };

  /// What the caller knows of where the closest point may be. It changes the time that a query takes, never
  /// the answer. For many points go through them by for_each_run() and give all of a run one Neighbourhood;
  /// for points that are asked about again after a small motion, give each its triangle of the last time.
  struct Hint {
    Hint(int triangle = -1) : near_triangle(triangle), near(nullptr) {}
    Hint(Neighbourhood& neighbourhood) : near_triangle(-1), near(&neighbourhood) {}

    int near_triangle;    ///< Negative: none.
    Neighbourhood* near;  ///< Null: none.
  };

  /// The closest point of the mesh within `max_distance`.
  std::optional<Closest> closest(const Eigen::Vector3f& point, float max_distance, Hint hint = {}) const;
  /// The same among triangles whose normal n has n . direction >= min_cosine: what keeps the two faces
  /// of a thin wall apart.
  std::optional<Closest> closest_facing(const Eigen::Vector3f& point, float max_distance,
                                        const Eigen::Vector3f& direction, float min_cosine,
                                        Hint hint = {}) const;

  const TriangleMesh& mesh() const;
  /// Unit normals of the triangles, zero for those without area.
  const std::vector<Eigen::Vector3f>& normals() const;

 private:
  friend class SignedDistance;
  /// What can be done with the mesh and its normals, which stay where they are, while the tree is built.
  using Meanwhile = std::function<void(const TriangleMesh&, const std::vector<Eigen::Vector3f>&)>;
  SurfaceIndex(TriangleMesh mesh, const Meanwhile& meanwhile);

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
