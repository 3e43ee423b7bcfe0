#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "gantry/geometry/closest_on_triangle.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry::internal {

/// Angle-weighted pseudonormals of a mesh's faces, edges and vertices (Baerentzen and Aanaes, "Signed
/// distance computation using the angle weighted pseudonormal", 2005). Edges and vertices are identified by
/// position, so that a mesh with split vertices serves as well. Triangles without area do not count.
class Pseudonormals {
 public:
  explicit Pseudonormals(const TriangleMesh& mesh);

  struct Pseudonormal {
    Eigen::Vector3f normal;  ///< Unit; zero where the faces around cancel each other.
    bool at_border;          ///< On the border of an open mesh: an edge of one triangle only, or its ends.
  };
  Pseudonormal of(int triangle, TriangleFeature feature) const;

 private:
  struct Edge {
    Eigen::Vector3d normals;  ///< Their sum.
    int triangles;
  };
  Edge edge(int triangle, int side) const;

  const TriangleMesh& mesh_;
  std::vector<int> joined_;      ///< For every vertex the first one at the same position.
  std::vector<uint32_t> first_;  ///< Of every vertex's triangles in around_; one more at the end.
  std::vector<int> around_;      ///< Triangles around each vertex.
  std::vector<Eigen::Vector3f> vertex_normals_;
  std::vector<char> vertex_at_border_;
};

}  // namespace gantry::internal
