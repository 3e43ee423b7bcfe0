#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "gantry/geometry/closest_on_triangle.h"
#include "gantry/geometry/triangle_mesh.h"
#include "large_pages.h"

namespace gantry::internal {

/// Angle-weighted pseudonormals of a mesh's faces, edges and vertices (Baerentzen and Aanaes, "Signed
/// distance computation using the angle weighted pseudonormal", 2005). Edges and vertices are identified by
/// position, so that a mesh with split vertices serves as well; triangles that are listed twice count once.
/// The mesh, and the unit normals of its triangles (zero without area), must outlive this.
class Pseudonormals {
 public:
  Pseudonormals(const TriangleMesh& mesh, const std::vector<Eigen::Vector3f>& normals);

  struct Pseudonormal {
    Eigen::Vector3f normal;  ///< Unit; zero where the faces around cancel each other.
    /// On the border of an open mesh: an edge of one triangle only, or its ends. Triangles without area close
    /// edges, as they do where tessellations meet, but open none.
    bool at_border;
  };
  Pseudonormal of(int triangle, TriangleFeature feature) const;

 private:
  Pseudonormal of_edge(int triangle, int side) const;
  Pseudonormal of_vertex(int vertex) const;
  /// The vertex at a corner.
  int at(int triangle, int corner) const {
    return joined_[static_cast<size_t>(mesh_.triangles[static_cast<size_t>(triangle)][corner])];
  }

  const TriangleMesh& mesh_;
  const std::vector<Eigen::Vector3f>& normals_;
  std::vector<int> joined_;      ///< For every vertex the first one at the same position.
  std::vector<uint32_t> first_;  ///< Of every vertex's triangles in around_; one more at the end.
  LargeVector<int> around_;      ///< Triangles around each vertex.
  LargeVector<Pseudonormal> vertices_;
};

}  // namespace gantry::internal
