#pragma once

#include <span>

#include "gantry/fusion/preprocess.h"
#include "gantry/fusion/registration.h"
#include "gantry/fusion/sampling.h"

namespace gantry {

struct GlobalIcpOptions {
  SamplingStrategy sampling = SamplingStrategy::kNormalSpace;
  size_t samples = 8000;  ///< Points chosen of each scan.
  /// Search radius; 0: begins as wide as the tagged poses are uncertain and ends at four point spacings.
  double max_distance_mm = 0;
  double max_deviation_mads = 3;    ///< Rejection by distance: in standard deviations by the MAD of the pair.
  double max_roughness_sigmas = 4;  ///< Rejection by roughness: spread about the tangent plane, in noise.
  double start_angle_rad = 0.6109;  ///< Rejection by normals: 35 degrees while the radius is wide, ...
  double max_angle_rad = 0.1745;    ///< ... 10 degrees at the end.
  double min_overlap = 0.1;         ///< Pairs predicted to share less (fraction) are left out.
  int max_iterations = 80;
  /// Done when no scan's surface moves further than this; 0: a fiftieth of the median noise.
  double tolerance_mm = 0;
};

/// The paper's "Global ICP" after Glira, Pfeifer, Briese and Ressl (2015), "A correspondence framework for
/// ALS strip adjustments based on variants of the ICP algorithm": the poses of all scans in one least-squares
/// adjustment, with five steps in every iteration.
///
/// 1. Selection: points of each scan by a sampling strategy, once.
/// 2. Matching: each to the nearest point of every overlapping scan, at the present poses.
/// 3. Rejection: by distance from the median of the pair's residuals, by roughness of the surface around
///    the point, by the angle between the normals, and on the rim of the data.
/// 4. Weighting: 1 / sigma^2 with sigma from the MAD of the pair's residuals.
/// 5. Adjustment: the sum of squared point-to-plane distances, with the tagged poses as observations of
///    their covariance.
///
/// The first scan's pose is kept. The same input gives the same poses for any number of threads. Throws
/// InputError for options out of range.
Registration register_global_icp(std::span<const ScanSurface> surfaces, const GlobalIcpOptions& options);

}  // namespace gantry
