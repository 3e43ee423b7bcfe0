#pragma once

#include <cstdint>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// `count` points drawn at random from a mesh, every piece of its area as likely as any other, with the
/// normals of their triangles. The same seed gives the same points. Throws InputError for a mesh without
/// area.
PointCloud sample_surface(const TriangleMesh& mesh, size_t count, uint64_t seed);

}  // namespace gantry
