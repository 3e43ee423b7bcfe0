#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"
#include "report/measured_surface.h"

namespace gantry::report {

/// The CAD surface with what was measured on it, as the interactive view draws it: triangles that are fine
/// where the deviation changes and coarse elsewhere.
struct SurfaceModel {
  struct Vertex {
    Eigen::Vector3f position, normal;
    float deviation_mm = 0;    ///< Where not `seen`: that of seen neighbours, so that colours end cleanly.
    float uncertainty_mm = 0;  ///< Standard uncertainty.
    float defect_share = 0;    ///< Of the measured surface around it.
    int defect = 0;            ///< The defect with the most weight around it; 0: none.
    bool seen = false;
  };

  std::vector<Vertex> vertices;  ///< Apart along creases, for faces that meet there deviate each by itself.
  std::vector<Eigen::Vector3i> triangles;
  std::vector<std::array<Eigen::Vector3f, 2>> creases;  ///< Sharp edges and borders, to be drawn as lines.
};

/// At most `most_triangles`, whatever the size of the CAD model: one that is finer is made coarser first, by
/// putting together the vertices of a cell that face the same way. The same for any number of threads.
SurfaceModel surface_model(const TriangleMesh& cad, const MeasuredSurface& measured, double tolerance_mm,
                           size_t most_triangles);

}  // namespace gantry::report
