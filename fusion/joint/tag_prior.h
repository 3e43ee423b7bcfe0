#pragma once

#include <span>
#include <vector>

#include "gantry/fusion/range_surface.h"

namespace gantry::internal {

/// What the tags say of all poses together. Errors are twists about the problem's centre, in the part frame,
/// one below the other; that of scan i is (UncertainPose)
///
///   error_i = F_i z + own_i,   z ~ N(0, 1) common to all scans,   own_i ~ N(0, D_i),
///
/// so that all errors together are one Gaussian with covariance D + F F^T, D = blockdiag(D_i). Without shared
/// factors F has no columns and each scan has a prior of its own.
///
/// D_i is the independent covariance, a millionth of a mm and rad (a tag without any error would make the
/// rest singular), and what the first order leaves out: poses are not linear in the parameters, and common
/// errors of a rotation by theta rad and a shift by t mm leave about theta^2 and theta t behind.
class TagPrior {
 public:
  TagPrior() = default;
  /// Throws InputError when factors hold numbers that are not finite, or belong to different parameters: not
  /// the same number of columns, or not the same calibration. Scans without a factor may be among them.
  TagPrior(std::span<const RangeSurface> scans, const Eigen::Vector3d& centre);

  Eigen::Index parameters() const { return factor_.cols(); }

  /// (D + F F^T)^-1, 6 n x 6 n.
  const Eigen::MatrixXd& information() const { return information_; }
  /// (D_i + F_i F_i^T)^-1: of one scan, nothing being known of the others.
  Matrix6d information_of(size_t scan) const;

  /// How far from the tags: errors^T information errors, taken apart. z is the common error that explains
  /// `errors` best; then chi-squares add up to the whole.
  struct ChiSquare {
    double shared = 0;        ///< z^T z, at most parameters() degrees of freedom.
    std::vector<double> own;  ///< Of what z leaves, against D_i: at most 6 degrees of freedom each.
  };
  ChiSquare chi_square(const Eigen::VectorXd& errors) const;

  /// At most the smallest eigenvalue of the information on errors in units of `unit`, at least half of it.
  double weakest(const Vector6d& unit) const;

 private:
  std::vector<Matrix6d> own_covariance_, own_information_;  ///< D_i and its inverse.
  Eigen::MatrixXd factor_;                                  ///< F, 6 n x parameters.
  Eigen::MatrixXd z_from_errors_;                           ///< The best z, parameters x 6 n.
  Eigen::MatrixXd information_;
};

}  // namespace gantry::internal
