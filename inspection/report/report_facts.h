#pragma once

#include <array>
#include <vector>

#include "report/coverage_sides.h"
#include "report/distribution.h"
#include "report/sections.h"

namespace gantry::report {

/// What the report tells beyond InspectionResult, worked out once for the page and for report.json.
struct ReportFacts {
  Distribution distribution;
  std::vector<Section> sections;
  std::array<SideCoverage, 6> sides;
  double surface_mm2 = 0;  ///< Of the CAD model.
  size_t triangles = 0;    ///< Of its mesh.
};

}  // namespace gantry::report
