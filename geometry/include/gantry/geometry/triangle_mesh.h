#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry {

/// A triangle mesh in mm. Vertices of a triangle run counter-clockwise seen from outside, so that
/// triangle normals point out of the material.
struct TriangleMesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Eigen::Vector3i> triangles;

  Eigen::AlignedBox3f bounds() const;
  /// Unit normal of triangle `t`; zero for a degenerate triangle.
  Eigen::Vector3f normal(size_t t) const;
  double area(size_t t) const;
  double surface_area() const;
  /// Enclosed volume (mm^3) of a closed mesh, positive when the triangles face outwards.
  double volume() const;
};

TriangleMesh transformed(const TriangleMesh& mesh, const Pose& target_from_mesh);
/// `a` followed by `b`, as separate shells of one mesh.
TriangleMesh merged(const TriangleMesh& a, const TriangleMesh& b);

}  // namespace gantry
