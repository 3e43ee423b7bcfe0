#pragma once

#include <span>

#include "gantry/fusion/joint.h"
#include "joint/problem.h"

namespace gantry::internal {

/// Levels, centre, medians and priors of these scans, which must outlive the problem.
JointProblem make_problem(std::span<const RangeSurface> scans, const JointOptions& options);

/// The largest displacement, at the part's radius, that the tags' covariance makes likely (one sigma).
double tag_sigma_mm(const JointProblem& problem);

}  // namespace gantry::internal
