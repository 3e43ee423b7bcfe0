#pragma once

#include <span>

#include "gantry/fusion/range_surface.h"
#include "gantry/fusion/registration.h"

namespace gantry {

/// Nothing has to be set: 0 (or empty) means chosen from pixel pitch, sensor noise and the covariance of
/// the tagged poses. What was chosen, and why, is in Registration::parameters.
struct JointOptions {
  double start_mm = 0;          ///< How far apart matching surfaces may lie at the beginning.
  double noise_mm = 0;          ///< Sensor noise along the normal, one sigma.
  size_t coarse_samples = 0;    ///< Of each scan, in the coarse stage.
  size_t max_partners = 0;      ///< Scans that one scan is matched with: the ones with most in common.
  bool global_fallback = true;  ///< Search without the tagged poses when they lead nowhere.
  /// Scans that may be left out (ScanReport::left_out) of a result that is to be believed all the same.
  size_t allowed_left_out = 0;
};

/// Registration of all scans in one adjustment (method "joint"): every pose is unknown at once, and every
/// scan is matched against every other that it shares surface with, on the measured points themselves.
///
///  1. Coarse: range images thinned 16 and 8 fold; nearest compatible points, graduated robustness,
///     visibility (joint/coarse.h).
///  2. Fine: by projection into the range images, robust scale down to the noise (joint/matches.h); all
///     pixels in the last rounds. Edges of surfaces are matched to edges, and to the faces at which they end
///     (joint/edge_matches.h): they hold thin and flat parts in the directions in which surfaces slide, and
///     the scans of both sides of a plate to each other. What edges have in common, above all how much they
///     are broken, is unknown and estimated with the poses.
///  3. Judgement (joint/judgement.h, joint/solution.h): free-space violation, opposite-face contact, the
///     wobble test, prior chi-square, leave-one-scan-out, residuals far beyond the noise, a last round that
///     still moved. A result that fails is tried again from a wider start; then, of up to 16 scans, the
///     arrangements in which they fit are searched and compared (joint/arrangements.h: scans of a part that
///     is nearly symmetric fit in more than one place), also when a pose ended where its tag makes it
///     unlikely; then scan by scan from many starts and global proposals (joint/recovery.h). In a set of more
///     than 32 only the suspicious scans are placed again, first of all. What still fails, or is ambiguous,
///     is returned with a reason, never as a success.
///  4. Where a few scans (a quarter at most, and not the first) are all that is wrong, they are left out: the
///     others are adjusted and judged as if these were not there (joint/attempt.h). ScanReport::left_out says
///     why; the result is not believed unless JointOptions::allowed_left_out allows as many.
///
/// Tagged poses enter with their covariance, as one factor on all scans together: errors that the scans
/// share (UncertainPose::shared_factor) leave their relative poses known (joint/tag_prior.h). Covariances of
/// the result are those of errors relative to the first scan, by the jackknife over patches of surface
/// (joint/covariance.h). The same on any number of threads. Throws InputError for options out of range, no
/// scan at all, or shared factors of different calibrations or numbers of parameters.
Registration register_joint(std::span<const RangeSurface> scans, const JointOptions& options);

}  // namespace gantry
