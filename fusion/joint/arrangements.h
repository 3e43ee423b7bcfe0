#pragma once

#include "joint/problem.h"

namespace gantry::internal {

/// Sets all scans anew, one by one, and keeps several half-built arrangements at a time: on a part that is
/// nearly symmetric a scan may fit in several places, and only what comes later tells which was right.
/// Returns the `most` best arrangements that differ, best first, to be adjusted and judged. The cost grows
/// with the cube of the number of scans: for few.
std::vector<Poses> search_arrangements(const JointProblem& problem, const Poses& poses, size_t most);

}  // namespace gantry::internal
