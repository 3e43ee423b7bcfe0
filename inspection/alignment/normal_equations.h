#pragma once

#include <vector>

#include "alignment/samples.h"

namespace gantry::internal {

constexpr double kTukey = 4.685;  ///< 95 % efficiency for Gaussian noise.

/// A point-to-plane fit at its present pose, in the coordinates of a FitFrame.
struct NormalEquations {
  Matrix6d hessian = Matrix6d::Zero();    ///< With Tukey's weights: for the step.
  Matrix6d curvature = Matrix6d::Zero();  ///< With the derivative of his psi: for the covariance.
  Matrix6d pretended = Matrix6d::Zero();  ///< The part of the Hessian that facets of a round surface give.
  Vector6d gradient = Vector6d::Zero();
  double weight = 0;  ///< Sum of the weights.
  double sigma = 0;   ///< Of the residuals of a sample with weight 1.
  double rms_mm = 0;  ///< Of the inliers.
  size_t inliers = 0;
};

/// Samples with `masked` set take no part. `facet_angle` is per triangle, see facet_angles().
NormalEquations normal_equations(const std::vector<Pair>& pairs, const std::vector<double>& weight,
                                 const std::vector<unsigned char>& masked,
                                 const std::vector<double>& facet_angle, const FitFrame& frame);

/// Tukey's weight and the derivative of his psi at a residual in units of sigma; both 0 beyond kTukey.
struct TukeyWeight {
  double weight = 0, slope = 0;
};
TukeyWeight tukey(double residual);

/// Which motions the points hold: orthonormal bases, in the coordinates of the FitFrame.
struct HeldMotions {
  Eigen::Matrix<double, 6, Eigen::Dynamic> held, free;
};

/// A direction is free when the points' normals hold it less than facets (twice, to be safe) pretend to, or
/// by next to nothing.
HeldMotions split_motions(const NormalEquations& equations);

}  // namespace gantry::internal
