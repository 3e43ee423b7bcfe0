#pragma once

#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry::internal {

/// Fraction of a mesh's area within `radius_mm` of one of the points and facing the same way (within
/// 60 degrees; points without normals face every way). By area-uniform samples with a fixed seed.
double surface_coverage(const TriangleMesh& mesh, const PointCloud& feet, double radius_mm);

}  // namespace gantry::internal
