#pragma once

#include <memory>
#include <vector>

#include "alignment/normal_equations.h"
#include "gantry/geometry/cloud_sources.h"

namespace gantry::internal {

/// How a fit follows errors of the scans' poses: `matrix[k]` times the error of scan k's pose (a twist in the
/// CAD frame) is the motion of the cloud that takes it up, with its sign turned round. All of them together
/// hold a motion of the whole cloud entirely, but along what is free. Empty without sources.
std::vector<Matrix6d> scan_influence(const AlignmentSamples& samples, const std::vector<Pair>& pairs,
                                     const std::vector<unsigned char>& masked,
                                     const NormalEquations& equations, const HeldMotions& motions,
                                     const FitFrame& frame);

}  // namespace gantry::internal
