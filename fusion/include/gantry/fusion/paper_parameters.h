#pragma once

#include <span>
#include <vector>

#include "gantry/fusion/preprocess.h"
#include "gantry/fusion/registration.h"

namespace gantry {

/// The three parameters that the paper's user sets (sections "Pose Graph Parameters" and "Parameter
/// Investigation"), under its names, and what it found of how they hang together:
///
///   voxel_size               2 (mm) for 100,000 to 500,000 points a scan; 1 and no downsampling for fewer
///   max_distance_threshold = voxel_size * m    with m in [1, 4]
///   edge_prune_threshold   = voxel_size / p    with p in [2, 4]
///
/// 0 everywhere means: chosen from the data, so that a part of 10 mm and one of 1 m both work.
///
/// The edge prune threshold has a unit here: the distance (mm) by which an edge may disagree with the final
/// poses at the centre of its source scan, as far as its own data can tell. In Open3D, on which the paper's
/// plugin stands, the number is a dimensionless confidence in (0, 1]: that of the line process,
/// l = (mu / (mu + e^T L e))^2 with mu = n d_max^2. With L from point-to-point matches e^T L e is about
/// n d^2, d being the disagreement, so that l = 1 / (1 + (d / d_max)^2)^2: see line_process_confidence. Its
/// default 0.25 cuts edges that disagree by the whole max_distance_threshold, and the paper's
/// voxel_size / p = 1.0 (voxel 2, p 2), read as a confidence, cuts every loop closure.
struct PaperParameters {
  double voxel_size_mm = 0;
  double m = 0;
  double p = 0;
  /// In place of m and p; each with its own 0 for "by the rule".
  double max_distance_threshold_mm = 0;
  double edge_prune_threshold_mm = 0;
};

/// The parameters as used.
struct ResolvedParameters {
  double voxel_size_mm = 0;
  bool downsample = true;  ///< False: too few points to lose any; voxel_size only scales the thresholds.
  double max_distance_threshold_mm = 0;
  /// The user fixed the threshold: matches are sought within it from the start. Otherwise the search begins
  /// as wide as the tagged poses are uncertain and ends at the threshold.
  bool fixed_distance = false;
  double edge_prune_threshold_mm = 0;
  std::vector<ParameterChoice> choices;
};

/// Checks what is given and chooses what is not. Throws InputError naming the parameter that is not finite,
/// negative, out of the paper's range (m, p), below what the data can serve (voxel_size below the point
/// spacing with downsampling), or given twice (m and max_distance_threshold_mm).
ResolvedParameters resolve(const PaperParameters& parameters, std::span<const ScanSurface> surfaces);

/// Open3D's confidence in an edge that disagrees by `disagreement_mm`; and the disagreement of a confidence.
double line_process_confidence(double disagreement_mm, double max_distance_threshold_mm);
double disagreement_at_confidence_mm(double confidence, double max_distance_threshold_mm);

}  // namespace gantry
