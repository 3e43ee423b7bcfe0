#pragma once

#include <cstddef>
#include <string>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// What is wrong with a mesh, counted. A mesh is watertight when every edge is shared by exactly two
/// triangles that run along it in opposite directions. Edges are identified by the position of their ends.
struct MeshTopology {
  size_t boundary_edges = 0;      ///< Edges of one triangle only: the mesh is open there.
  size_t nonmanifold_edges = 0;   ///< Edges of three or more triangles.
  size_t inconsistent_edges = 0;  ///< Two triangles that run the same way: one of them is flipped.
  size_t degenerate_triangles = 0;
  size_t shells = 0;  ///< Pieces that share no vertex.
  /// Shells that face inwards for certain: the volume that they enclose is negative, however their holes are
  /// closed, and they are no cavity inside another shell. A shell with inconsistent or non-manifold edges has
  /// no side that is certain, and is not counted.
  size_t inside_out_shells = 0;

  bool watertight() const { return boundary_edges + nonmanifold_edges + inconsistent_edges == 0; }
  /// One line for a person: "watertight" or the counts.
  std::string text() const;
};

MeshTopology analyse_topology(const TriangleMesh& mesh);

}  // namespace gantry
