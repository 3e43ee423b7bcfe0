#pragma once

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"
#include "gantry/geometry/signed_distance.h"

namespace gantry {

struct AlignmentOptions {
  double initial_distance_mm = 5.0;  ///< Points further from the model than this are left out at first.
  size_t samples = 20000;            ///< Points used, spread evenly over the cloud.
  int max_iterations = 60;
  double max_angle_rad =
      0.7854;  ///< A point pairs with faces whose normal is within this of its own (45 degrees).
};

/// Robust best fit of a cloud to a CAD model.
struct AlignmentResult {
  Pose cad_from_cloud = Pose::Identity();
  Matrix6d covariance =
      Matrix6d::Zero();      ///< Of cad_from_cloud, errors in the CAD frame (see UncertainPose).
  double rms_before_mm = 0;  ///< Over the samples within the initial distance.
  double rms_after_mm = 0;   ///< Over the inliers.
  double inlier_fraction = 0;
  int iterations = 0;
  bool converged = false;
};

/// Iteratively reweighted point-to-plane fit with Tukey's biweight, whose scale comes from the
/// residuals' MAD and narrows as the fit improves, so that real defects lose their pull. The start is
/// the cloud's own frame: within a few mm and degrees of the model.
AlignmentResult align_to_model(const PointCloud& cloud, const SignedDistance& model,
                               const AlignmentOptions& options);

}  // namespace gantry
