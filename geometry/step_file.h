#pragma once

#include <filesystem>

#include "gantry/geometry/mesh_file.h"

namespace gantry::internal {

/// The solids and surfaces of a STEP file as one triangle soup in mm: each face is cut for itself, with the
/// same points along the edges that faces share. The file's unit is read from it. It is read in a process of
/// its own (see isolated.h): OpenCASCADE crashes on some damaged files and takes for ever over others. Throws
/// InputError naming the file, and always in a build without OpenCASCADE.
TriangleMesh read_step(const std::filesystem::path& path, const TessellationOptions& options,
                       std::string& tessellation);

}  // namespace gantry::internal
