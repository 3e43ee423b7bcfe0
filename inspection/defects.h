#pragma once

#include <vector>

#include "gantry/inspection/inspection.h"
#include "local_surface.h"

namespace gantry::internal {

/// Groups the points out of tolerance into defects, sorted by falling |peak|, and marks them in
/// `result.defect_id`. A peak is looked for away from the rims of the measured surface where there is
/// a choice, and between the points: the middle of a missing hole is rarely hit by one.
void find_defects(InspectionResult& result, const internal::LocalSurface& surface,
                  const SignedDistance& reference, const InspectionOptions& options);

}  // namespace gantry::internal
