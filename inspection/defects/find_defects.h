#pragma once

#include "defects/region_points.h"

namespace gantry::internal {

/// Groups the points out of tolerance into defects, sorted by falling |peak|, tells what each is, and marks
/// them in `result.defect_id`. A peak is looked for away from the rims of the measured surface where there is
/// a choice, and between the points: the middle of a missing hole is rarely hit by one. `result.faces` must
/// be known. `sources` may be null: no residue is then looked for.
void find_defects(InspectionResult& result, const LocalSurface& surface, const SignedDistance& reference,
                  const CadFaces& cad, const JudgedFeet& feet, const CoverageSamples& samples,
                  const InspectionOptions& options, const CloudSources* sources);

}  // namespace gantry::internal
