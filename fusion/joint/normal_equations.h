#pragma once

#include <Eigen/Core>
#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry::internal {

/// What the matches of one ordered pair of scans say about the motion of the one against the other:
/// sums over residuals r = n . (p - q), p on the source, q on the target, weighted by w, with
/// a = dr/d(error of the source) = [(p - centre) x n; n] = -dr/d(error of the target).
/// Errors are twists in the part frame about a common centre: pose = shifted_exp(error) * pose.
struct PairSum {
  Matrix6d hessian = Matrix6d::Zero();     ///< sum w a a^T
  Matrix6d tilts = Matrix6d::Zero();       ///< The part of it that noise in the normals pretends.
  Vector6d gradient = Vector6d::Zero();    ///< sum w a r
  Vector6d directions = Vector6d::Zero();  ///< sum w a; of edges only.
  double offset = 0;                       ///< sum w r; of edges only.
  double weight = 0;                       ///< sum w
  double stiffness = 0;  ///< sum of second derivatives of the robust costs; w of plain squares.
  double cost = 0;       ///< sum of robust costs
  size_t matches = 0;

  /// `arm` is p - centre; noise tilts n about each axis across it with a variance of `tilt_variance` (rad^2).
  void add(const Eigen::Vector3d& arm, const Eigen::Vector3d& n, double r, double w,
           double tilt_variance = 0) {
    Vector6d a;
    a << arm.cross(n), n;
    hessian.noalias() += w * a * a.transpose();
    gradient += w * r * a;
    weight += w;
    stiffness += w;
    ++matches;
    if (tilt_variance == 0) return;
    Eigen::Matrix<double, 6, 3> of_any_direction;
    of_any_direction << cross_matrix(arm), Eigen::Matrix3d::Identity();
    tilts.noalias() +=
        tilt_variance * w * (of_any_direction * of_any_direction.transpose() - a * a.transpose());
  }
  PairSum& operator+=(const PairSum& o);

  /// Makes the Hessian, so far that of weighted squares, that of the robust cost: near the minimum residuals
  /// pull less the larger they are. Newton's steps, and what is claimed to be known, depend on it.
  /// Returns the factor.
  double soften();
  /// Takes out what the noise in normals adds: what it pretends to hold, and the pull in directions in
  /// which it is all there is, which would let surfaces wander. Returns the factor of the gradient.
  Matrix6d take_out_tilts();
};

/// The normal equations of all poses together.
class NormalEquations {
 public:
  explicit NormalEquations(size_t scans)
      : hessian_(Eigen::MatrixXd::Zero(6 * scans, 6 * scans)), gradient_(Eigen::VectorXd::Zero(6 * scans)) {}

  void add_pair(size_t target, size_t source, const PairSum& sum, double factor = 1);
  /// A factor on one pose alone: cost (error + offset)^T information (error + offset).
  void add_prior(size_t scan, const Matrix6d& information, const Vector6d& offset);
  /// The same on all poses together, 6 rows a scan.
  void add_prior(const Eigen::MatrixXd& information, const Eigen::VectorXd& offset);

  /// Takes an unknown out that is shared by all scans: its mixed derivatives, its own, all times `factor`.
  void eliminate(const Eigen::VectorXd& mixed, double hessian, double gradient, double factor = 1);

  const Eigen::MatrixXd& hessian() const { return hessian_; }
  const Eigen::VectorXd& gradient() const { return gradient_; }
  /// The step that minimises the quadratic; rows and columns are scaled first, because radians and
  /// millimetres differ. Unconstrained directions are left alone.
  Eigen::VectorXd solve() const;

 private:
  Eigen::MatrixXd hessian_;
  Eigen::VectorXd gradient_;
};

/// The motion by a twist about `centre` instead of the origin.
Pose exp_about(const Eigen::Vector3d& centre, const Vector6d& twist);
/// Inverse of exp_about.
Vector6d log_about(const Eigen::Vector3d& centre, const Pose& motion);
/// Turns errors about `from` into those about `to`.
Matrix6d shifted_errors(const Eigen::Vector3d& from, const Eigen::Vector3d& to);
/// Turns a covariance of errors about `from` into that of errors about `to`.
Matrix6d shifted_covariance(const Matrix6d& covariance, const Eigen::Vector3d& from,
                            const Eigen::Vector3d& to);
/// The covariance of several errors, 6 rows each, when all of them are turned by `by` (as shifted_errors()).
Eigen::MatrixXd carried_covariance(const Eigen::MatrixXd& covariance, const Matrix6d& by);

}  // namespace gantry::internal
