#pragma once

#include <filesystem>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry::internal {

/// The triangles of a PLY file as they stand there (polygons as fans), in the file's unit. Read by PCL
/// because Assimp's PLY reader runs past the end of a truncated file. Throws InputError naming the file.
TriangleMesh read_ply_triangles(const std::filesystem::path& path);

}  // namespace gantry::internal
