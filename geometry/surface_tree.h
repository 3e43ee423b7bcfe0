#pragma once

#include <cstddef>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"
#include "lanes.h"
#include "large_pages.h"

namespace gantry::internal {

/// Eight triangles as the search wants them; lanes that are not used lie far outside and name triangle -1.
struct TriangleBlock {
  Lanes3 a, ab, ac;                          ///< First corner, and from it to the second and the third.
  Lanes3 n;                                  ///< Unit normals.
  Lanes inverse_ab, inverse_ac, inverse_bc;  ///< 1 / squared lengths of the sides.
  int triangle[kLanes];
};

/// Eight boxes and what is in them: a node, or ~a block; children that are not used lie far outside.
struct TreeNode {
  Lanes3 low, high;
  int child[kLanes];
};

/// A bounding volume hierarchy with eight children a node (Wald, Benthin and Boulos, "Getting rid of
/// packets", 2008), built top-down by binned surface area (Wald, "On fast construction of SAH-based bounding
/// volume hierarchies", 2007). Triangles without area are left out. The first node is the root.
struct SurfaceTree {
  static constexpr int kMostLevels = 56;
  static constexpr float kFarOutside_mm =
      1e18f;  ///< Of lanes that are not used; its square still fits a float.

  LargeVector<TreeNode> nodes;
  LargeVector<TriangleBlock> blocks;
  std::vector<int> block_of_triangle;  ///< -1 for those that are left out.
  size_t triangles = 0;                ///< That have an area.
  float longest_side = 0;              ///< mm

  SurfaceTree() = default;
  /// With the unit normals of the triangles, zero for those without area.
  SurfaceTree(const TriangleMesh& mesh, const std::vector<Eigen::Vector3f>& normals);
};

}  // namespace gantry::internal
