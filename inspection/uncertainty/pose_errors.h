#pragma once

#include "gantry/geometry/cloud_sources.h"
#include "gantry/inspection/alignment.h"

namespace gantry::internal {

/// What the errors of all scans' poses do to deviations. With e_k the error of scan k (a twist in the CAD
/// frame), s_k its share in a point and A_k the alignment's influence (AlignmentResult::scan_influence), the
/// point moves against the model by
///
///   sum over k of s_k e_k  -  sum over k of A_k e_k
///
/// so that what all scans have in common cancels where the cloud is aligned, and counts in full where it is
/// taken as it stands.
class PoseErrors {
 public:
  /// Nothing is known: all variances are zero.
  PoseErrors() = default;
  PoseErrors(const CloudSources& sources, const AlignmentResult& alignment);

  /// Of a point's displacement along a direction: `row` = (point x direction, direction), CAD frame.
  double variance(std::span<const CloudSources::Share> shares, const Vector6d& row) const;

 private:
  Eigen::MatrixXd covariance_;  ///< Of every scan's motion against the model, 6 rows each.
};

}  // namespace gantry::internal
