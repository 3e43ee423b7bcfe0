#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

namespace gantry::internal {

/// Delaunay triangulation of a handful of points in the plane: triples of indices, no two of which overlap.
/// By its definition as the underside of the points lifted onto a paraboloid: for a few neighbours nothing is
/// simpler, and little is faster. Where four points lie on one circle, one of the two ways is taken. Points
/// in a line have no triangles. O(n^4) at worst: not for more than some dozens of points.
void delaunay(std::span<const Eigen::Vector2d> points, std::vector<std::array<int, 3>>& triangles);

}  // namespace gantry::internal
