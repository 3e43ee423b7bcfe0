#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry::bench {

/// Every triangle cut in four at the middles of its sides.
TriangleMesh subdivided(const TriangleMesh& mesh);

/// Points within 1 mm of the surface, evenly over it, in no order.
PointCloud points_near(const TriangleMesh& mesh, size_t count, uint64_t seed = 1);

/// Raw, because a file format's reader would show in the peak of memory.
void write_raw(const std::filesystem::path& path, const PointCloud& cloud);
void write_raw(const std::filesystem::path& path, const TriangleMesh& mesh);
void write_raw(const std::filesystem::path& path, const std::vector<float>& distances);
PointCloud read_raw_cloud(const std::filesystem::path& path);
TriangleMesh read_raw_mesh(const std::filesystem::path& path);
std::vector<float> read_raw_distances(const std::filesystem::path& path);

}  // namespace gantry::bench
