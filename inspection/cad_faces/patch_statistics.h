#pragma once

#include "gantry/inspection/cad_faces.h"
#include "gantry/inspection/inspection.h"
#include "judged_feet.h"
#include "surface_coverage.h"

namespace gantry::internal {

/// Fills `result.faces` and `result.regions` from the judged points.
void measure_surface(InspectionResult& result, const TriangleMesh& mesh, const CadFaces& cad,
                     const JudgedFeet& feet, const CoverageSamples& samples);

}  // namespace gantry::internal
