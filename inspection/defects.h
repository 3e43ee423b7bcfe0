#pragma once

#include <vector>

#include "gantry/inspection/inspection.h"

namespace gantry::internal {

/// Groups the points out of tolerance into defects and marks them in `result.defect_id`. Works on the
/// averaged deviations of `result`; defects come out sorted by falling |peak|.
void find_defects(InspectionResult& result, const InspectionOptions& options);

}  // namespace gantry::internal
