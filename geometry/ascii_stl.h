#pragma once

#include <filesystem>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry::internal {

/// Whether an STL file is the text variant: it begins with "solid", as do the headers of some binary files,
/// and its size is not that of a binary one.
bool is_ascii_stl(const std::filesystem::path& path);

/// All solids of the file as one triangle soup, in the file's unit. Keywords in any case; normals and names
/// are passed over. Our own because Assimp leaks memory on every file of this kind that it refuses. Throws
/// InputError naming file and line when the file is broken or truncated.
TriangleMesh read_ascii_stl(const std::filesystem::path& path);

}  // namespace gantry::internal
