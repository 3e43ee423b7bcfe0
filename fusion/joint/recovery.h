#pragma once

#include "joint/judgement.h"
#include "joint/problem.h"

namespace gantry::internal {

/// Looks for poses without believing the ones at hand: keeps the largest set of scans that agree with each
/// other and sets the others, one by one, where they agree with it best, from many starts around their
/// tags and, if none fits, from what surface features propose (global_initialisation.h). Returns poses to
/// be adjusted and judged like any others. `suspects` (by scan) are not kept.
Poses recover(const JointProblem& problem, const Poses& poses, const std::vector<bool>& suspects,
              bool global);

/// The same, the scans of `core` being believed: only the others are placed anew.
Poses place_again(const JointProblem& problem, const Poses& poses, std::vector<size_t> core, bool global);

}  // namespace gantry::internal
