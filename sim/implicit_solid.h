#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// A solid as a function of space (mm): negative inside, positive outside, zero on its surface; near the
/// surface the value is the distance to it, or close to it. Solids are combined by the functions below.
using ImplicitSolid = std::function<double(const Eigen::Vector3d&)>;

// Each takes the values a and b of two solids at one point. `common` is their intersection (cut b away:
// common(a, -b)), `joined` their union. A sharp edge is std::max or std::min.

/// Edges broken at 45 degrees, `width` mm along either side where the two meet at a right angle.
inline double common_chamfered(double a, double b, double width) {
  return std::max({a, b, (a + b + width) * std::sqrt(0.5)});
}
/// Edges rounded to the given radius.
inline double common_rounded(double a, double b, double radius) {
  return std::min(-radius, std::max(a, b)) + std::hypot(std::max(radius + a, 0.0), std::max(radius + b, 0.0));
}
/// Inner corners filled to the given radius.
inline double joined_filleted(double a, double b, double radius) {
  return -common_rounded(-a, -b, radius);
}

/// Meshes the part of the surface inside `box`, which must hold the whole solid. Dual contouring (Ju et
/// al., "Dual contouring of Hermite data", 2002): one vertex for each grid cell that the surface passes,
/// placed where the tangent planes at the cell's crossed edges meet, so that edges stay sharp; planes are
/// exact, a surface of radius R is met to about cell^2 / (8 R). Watertight and manifold as long as no two
/// sheets of the surface pass one cell: walls and gaps must be wider than two cells.
TriangleMesh polygonise(const ImplicitSolid& solid, const Eigen::AlignedBox3d& box, double cell_mm);

}  // namespace gantry
