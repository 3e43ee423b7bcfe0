#include "joint/normal_equations.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>

namespace gantry::internal {
namespace {

/// A direction of which so much is pretence is not believed at all: the variance of the tilts is an estimate.
constexpr double kMostPretence = 0.67;

/// Far from the minimum the robust cost is not convex.
constexpr double kLeastStiffness = 0.4;

}  // namespace

PairSum& PairSum::operator+=(const PairSum& o) {
  hessian += o.hessian;
  tilts += o.tilts;
  gradient += o.gradient;
  directions += o.directions;
  offset += o.offset;
  weight += o.weight;
  stiffness += o.stiffness;
  cost += o.cost;
  matches += o.matches;
  return *this;
}

double PairSum::soften() {
  const double factor = weight > 0 ? std::clamp(stiffness / weight, kLeastStiffness, 1.0) : 1;
  hessian *= factor;
  tilts *= factor;
  return factor;
}

Matrix6d PairSum::take_out_tilts() {
  // In coordinates in which the whole Hessian is one, eigenvectors of the tilts are directions and their
  // eigenvalues how much of what is known of each is pretence.
  const Vector6d scale = hessian.diagonal().cwiseMax(1e-300).cwiseSqrt();
  const Matrix6d scaled = scale.cwiseInverse().asDiagonal() * hessian * scale.cwiseInverse().asDiagonal();
  const Eigen::LLT<Matrix6d> root((scaled + 1e-9 * Matrix6d::Identity()).eval());
  const Matrix6d relative = root.matrixL().solve(
      (scale.cwiseInverse().asDiagonal() * tilts * scale.cwiseInverse().asDiagonal()).eval());
  const Matrix6d pretended = root.matrixL().solve(relative.transpose().eval());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(0.5 * (pretended + pretended.transpose()));
  const Vector6d pretence = solver.eigenvalues().cwiseMax(0).cwiseMin(1);
  const Vector6d kept = (1 - pretence.array() / kMostPretence).cwiseMax(0);
  const Matrix6d axes = scale.asDiagonal() * root.matrixL().toDenseMatrix() * solver.eigenvectors();
  const Matrix6d to_axes =
      solver.eigenvectors().transpose() * root.matrixL().solve(Matrix6d(scale.cwiseInverse().asDiagonal()));
  const Matrix6d factor = axes * kept.asDiagonal() * to_axes;
  const Vector6d held = kept.cwiseProduct(Vector6d::Ones() - pretence);
  hessian = axes * held.asDiagonal() * axes.transpose();
  gradient = factor * gradient;
  return factor;
}

void NormalEquations::add_pair(size_t target, size_t source, const PairSum& sum, double factor) {
  const auto t = static_cast<Eigen::Index>(6 * target), s = static_cast<Eigen::Index>(6 * source);
  const Matrix6d h = factor * sum.hessian;
  const Vector6d g = factor * sum.gradient;
  hessian_.block<6, 6>(s, s) += h;
  hessian_.block<6, 6>(t, t) += h;
  hessian_.block<6, 6>(s, t) -= h;
  hessian_.block<6, 6>(t, s) -= h;
  gradient_.segment<6>(s) += g;
  gradient_.segment<6>(t) -= g;
}

void NormalEquations::add_prior(size_t scan, const Matrix6d& information, const Vector6d& offset) {
  const auto s = static_cast<Eigen::Index>(6 * scan);
  hessian_.block<6, 6>(s, s) += information;
  gradient_.segment<6>(s) += information * offset;
}

void NormalEquations::add_prior(const Eigen::MatrixXd& information, const Eigen::VectorXd& offset) {
  hessian_ += information;
  gradient_.noalias() += information * offset;
}

void NormalEquations::eliminate(const Eigen::VectorXd& mixed, double hessian, double gradient,
                                double factor) {
  if (mixed.isZero(0)) return;
  hessian_.noalias() -= (factor / hessian) * mixed * mixed.transpose();
  gradient_ -= (factor * gradient / hessian) * mixed;
}

Eigen::VectorXd NormalEquations::solve() const {
  const Eigen::VectorXd scale = hessian_.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = scale.asDiagonal() * hessian_ * scale.asDiagonal();
  scaled.diagonal().array() += 1e-12;
  const Eigen::VectorXd down = -(scale.asDiagonal() * gradient_);
  const Eigen::LLT<Eigen::MatrixXd> root(scaled);
  if (root.info() == Eigen::Success) return scale.asDiagonal() * root.solve(down);
  return scale.asDiagonal() * scaled.ldlt().solve(down);
}

Pose exp_about(const Eigen::Vector3d& centre, const Vector6d& twist) {
  // Rotation about the centre, then the shift: what a small error of a pose is to a reader.
  Pose motion = Pose::Identity();
  motion.linear() = rotation_exp(twist.head<3>());
  motion.translation() = centre - motion.linear() * centre + twist.tail<3>();
  return motion;
}

Vector6d log_about(const Eigen::Vector3d& centre, const Pose& motion) {
  Vector6d twist;
  twist << rotation_log(motion.linear()), motion * centre - centre;
  return twist;
}

Matrix6d shifted_errors(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  Matrix6d shift = Matrix6d::Identity();
  shift.bottomLeftCorner<3, 3>() = -cross_matrix(to - from);
  return shift;
}

Matrix6d shifted_covariance(const Matrix6d& covariance, const Eigen::Vector3d& from,
                            const Eigen::Vector3d& to) {
  const Matrix6d shift = shifted_errors(from, to);
  return shift * covariance * shift.transpose();
}

Eigen::MatrixXd carried_covariance(const Eigen::MatrixXd& covariance, const Matrix6d& by) {
  Eigen::MatrixXd carried(covariance.rows(), covariance.cols());
  for (Eigen::Index i = 0; i < covariance.rows(); i += 6)
    for (Eigen::Index j = 0; j < covariance.cols(); j += 6)
      carried.block<6, 6>(i, j) = by * covariance.block<6, 6>(i, j) * by.transpose();
  return carried;
}

}  // namespace gantry::internal
