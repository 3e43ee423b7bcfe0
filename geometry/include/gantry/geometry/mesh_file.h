#pragma once

#include <filesystem>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// Reads STL (binary or ascii), PLY or OBJ; equal vertices are joined. `unit_mm` is the file's unit in
/// mm (1000 for a file in metres). Throws InputError naming the file when it is missing, broken, has
/// no triangles or holds a coordinate that is not finite.
TriangleMesh read_mesh(const std::filesystem::path& path, double unit_mm = 1.0);

/// Whether a file is to be read by read_mesh() rather than by read_point_cloud(): STL and OBJ are, a PLY when
/// it has faces. Throws InputError naming the file when it is missing or, for a PLY, broken.
bool holds_triangles(const std::filesystem::path& path);

/// Writes binary STL (.stl) or binary PLY (.ply), replacing the file in one step.
void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace gantry
