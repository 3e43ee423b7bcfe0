#pragma once

#include "gantry/inspection/inspection.h"

namespace gantry::internal {

/// Sets `result.verdict` and `result.reason` from everything else in it, by the rule that Verdict states.
void decide(InspectionResult& result, const InspectionOptions& options);

}  // namespace gantry::internal
