#pragma once

#include "gantry/geometry/signed_distance.h"
#include "gantry/inspection/inspection.h"
#include "local_surface.h"
#include "uncertainty/pose_errors.h"

namespace gantry::internal {

/// Standard uncertainty of deviations: the parts of UncertaintyBudget, added in squares.
class DeviationUncertainty {
 public:
  /// Of the points of `cloud` (CAD frame, normals or none), smoothed to `surface`. `sources` may be null. All
  /// have to outlive this.
  DeviationUncertainty(const PointCloud& cloud, const CloudSources* sources, const LocalSurface& surface,
                       const AlignmentResult& alignment, double systematic_sigma_mm);

  /// The variances (mm^2) of point i, which was measured to `value`.
  UncertaintyBudget variances(size_t i, const SignedDistance::Value& value) const;

 private:
  const PointCloud& cloud_;
  const CloudSources* sources_;
  const LocalSurface& surface_;
  const AlignmentResult& alignment_;
  double systematic_variance_;
  PoseErrors poses_;
};

}  // namespace gantry::internal
