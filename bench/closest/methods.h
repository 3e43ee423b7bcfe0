#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry::bench {

/// Signed distances of points to a mesh, everything included that is needed for them.
std::vector<float> by_gantry(const PointCloud& cloud, TriangleMesh mesh);
/// Without signs by Embree's point query, over points in the same order, each beginning from the distance to
/// where the one before ended; triangles are measured in double, each by a call back.
std::vector<float> by_embree(const PointCloud& cloud, const TriangleMesh& mesh);

/// Distances of points to the nearest of other points (by nanoflann, through PointIndex).
std::vector<float> nearest_by_gantry(const PointCloud& cloud, const PointCloud& others);
/// By nanoflann itself with its defaults, both clouds put in Morton order first.
std::vector<float> nearest_by_nanoflann(const PointCloud& cloud, const PointCloud& others);

}  // namespace gantry::bench
