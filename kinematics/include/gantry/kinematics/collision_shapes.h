#pragma once

#include <Eigen/Core>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

// Coarse closed meshes for the collision check, centred at the origin. Round ones lie outside of what they
// stand for, so that the check errs on the safe side; none adds more than half a percent of the radius
// (cylinder) or two percent (sphere). All throw InputError for sizes that are not positive.

TriangleMesh box_mesh(const Eigen::Vector3d& size_mm);
/// Along z.
TriangleMesh cylinder_mesh(double radius_mm, double height_mm);
TriangleMesh sphere_mesh(double radius_mm);

/// The convex hull of the mesh: far fewer triangles, and never less than the mesh. Throws InputError when
/// the mesh is flat. By Qhull.
TriangleMesh convex_hull(const TriangleMesh& mesh);
/// Its bounding box along its own axes.
TriangleMesh bounding_box_mesh(const TriangleMesh& mesh);

}  // namespace gantry
