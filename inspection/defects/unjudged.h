#pragma once

#include "defects/region_points.h"
#include "fixture.h"

namespace gantry::internal {

/// Fills `result.unseen`, `result.unseen_mm2` and `result.fixture_regions`.
void find_unjudged(InspectionResult& result, const CadFaces& cad, const CoverageSamples& samples,
                   const Fixture& fixture, const InspectionOptions& options);

}  // namespace gantry::internal
