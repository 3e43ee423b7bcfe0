#pragma once

#include <array>
#include <string>

#include "gantry/geometry/triangle_mesh.h"
#include "report/measured_surface.h"

namespace gantry::report {

/// How much of the faces that look along one of the CAD model's axes, more than along the others, was seen.
struct SideCoverage {
  std::string towards;  ///< "+x" ... "-z"
  double area_mm2 = 0;
  double seen = 0;  ///< Share of the area; 0 where there is none.
};

/// By points spread evenly over the surface, each seen if a judged point lies within 1 mm of it on a face
/// that looks the same way: as InspectionResult::coverage.
std::array<SideCoverage, 6> coverage_sides(const TriangleMesh& cad, const MeasuredSurface& measured);

}  // namespace gantry::report
