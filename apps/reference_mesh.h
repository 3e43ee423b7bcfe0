#pragma once

#include <filesystem>
#include <string>

#include "gantry/geometry/length_unit.h"
#include "gantry/geometry/mesh_file.h"

namespace gantry {

/// A mesh that something is measured against or told apart from, and how it was read.
struct ReferenceMesh {
  TriangleMesh mesh;
  SizedFile sized;
  std::string tessellation;  ///< See MeshReading.
};

/// Reads a mesh in `unit`, which `option` names on the command line (empty: there is none, the file is in
/// mm). A doubtful size, degenerate triangles and an open or inconsistent mesh are warned of in the log.
/// Throws InputError for what read_mesh() refuses and, with `sides_matter`, for a mesh that is inside out:
/// every deviation from it would have the wrong sign.
ReferenceMesh read_reference(const std::filesystem::path& path, const std::string& unit,
                             const std::string& option, bool sides_matter);

/// Throws InputError when the part is so small that the tolerance says nothing of it: its unit is a mistake.
void require_size_for_tolerance(const SizedFile& part, double tolerance_mm);

}  // namespace gantry
