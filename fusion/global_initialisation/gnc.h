#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry {

/// Two oriented points that may be the same place of one surface: position (mm) and unit normal in the
/// target's and in the source's frame.
struct OrientedMatch {
  Eigen::Vector3d target, target_normal;
  Eigen::Vector3d source, source_normal;
};

struct GncResult {
  Pose target_from_source = Pose::Identity();
  std::vector<size_t> inliers;  ///< Matches whose residual is within the bound, ascending.
};

/// The rigid transform that most matches agree with, without an initial guess: truncated least squares
/// by graduated non-convexity (Yang, Antonante, Tzoumas, Carlone 2020, "Graduated Non-Convexity for
/// Robust Spatial Perception", section IV). The squared residual of a match is
///   |q - (R p + t)|^2 + lever^2 |n_q - R n_p|^2,
/// with `lever_mm` the length at which a wrong normal counts as much as a wrong place, and is cut off at
/// noise_bound_mm^2. Every weighted step is solved in closed form (Horn 1987). Fewer than three matches
/// give no inliers.
GncResult align_by_gnc(std::span<const OrientedMatch> matches, double noise_bound_mm, double lever_mm);

}  // namespace gantry
