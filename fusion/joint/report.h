#pragma once

#include "gantry/fusion/joint.h"
#include "joint/attempt.h"
#include "joint/solution.h"

namespace gantry::internal {

/// What is handed out of a solution. `start_mm` as it was used.
Registration report_of(const JointProblem& problem, const JointOptions& options, double start_mm,
                       const Attempt& attempt, const Solution& solution);

}  // namespace gantry::internal
