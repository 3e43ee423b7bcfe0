#pragma once

#include <filesystem>
#include <numbers>
#include <string>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// How finely the curved faces of a STEP file are cut into triangles. The mesh lies within `chord_mm` of the
/// true surface, which is a systematic error of every deviation measured against it: keep it well below the
/// uncertainty of the measurement.
struct TessellationOptions {
  double chord_mm = 0.005;  ///< Largest distance of a triangle from its surface.
  double angle_rad =
      10 * std::numbers::pi / 180;  ///< Largest angle between normals of neighbours on one face.
};

/// What a reader of the result must know besides the mesh.
struct MeshReading {
  size_t collapsed_triangles = 0;  ///< Left out: two of their corners are at the same place.
  std::string tessellation;        ///< Of a STEP file, in words: unit of the file, chord, angle. Else empty.
};

/// Reads STL (binary or ascii), PLY, OBJ or, where the build has OpenCASCADE, STEP (.step, .stp); equal
/// vertices are joined. `unit_mm` is the file's unit in mm (1000 for a file in metres); a STEP file states
/// its own unit and takes none but 1. Throws InputError naming the file when it is missing, broken, has no
/// triangles or holds a coordinate that is not finite.
TriangleMesh read_mesh(const std::filesystem::path& path, double unit_mm = 1.0,
                       MeshReading* reading = nullptr, const TessellationOptions& tessellation = {});

/// Whether a file is to be read by read_mesh() rather than by read_point_cloud(): STL, OBJ and STEP are, a
/// PLY when it has faces. Throws InputError naming the file when it is missing or, for a PLY, broken.
bool holds_triangles(const std::filesystem::path& path);

/// Writes binary STL (.stl) or binary PLY (.ply), replacing the file in one step.
void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);

/// What this build makes of STEP files, for --version: "read by OpenCASCADE 7.6.3", or what to install.
std::string step_support();
/// Whether it reads them.
bool reads_step();

}  // namespace gantry
