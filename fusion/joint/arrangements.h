#pragma once

#include "joint/problem.h"

namespace gantry::internal {

struct Arrangement {
  Poses poses;
  double score = 0;  ///< By which those of one search compare; see Fit.
};

/// Sets all scans anew, one by one, and keeps several half-built arrangements at a time: on a part that is
/// nearly symmetric a scan may fit in several places, and only what comes later tells which was right.
/// Returns the `most` best arrangements that differ, best first, to be adjusted and judged. `poses`: as
/// tagged. The cost grows with the cube of the number of scans: for few.
std::vector<Arrangement> search_arrangements(const JointProblem& problem, const Poses& poses, size_t most);

/// Which scans lie elsewhere in the second arrangement, scan 0 taken as fixed, by more than coarse alignment
/// errs.
std::vector<size_t> placed_otherwise(const JointProblem& problem, const Poses& a, const Poses& b);

}  // namespace gantry::internal
