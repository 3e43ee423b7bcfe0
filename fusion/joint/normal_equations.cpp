#include "joint/normal_equations.h"

#include <Eigen/Cholesky>

namespace gantry::internal {

PairSum& PairSum::operator+=(const PairSum& o) {
  hessian += o.hessian;
  gradient += o.gradient;
  weight += o.weight;
  cost += o.cost;
  matches += o.matches;
  return *this;
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

Eigen::VectorXd NormalEquations::solve() const {
  const Eigen::VectorXd scale = hessian_.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = scale.asDiagonal() * hessian_ * scale.asDiagonal();
  scaled.diagonal().array() += 1e-12;
  return scale.asDiagonal() * scaled.ldlt().solve(-(scale.asDiagonal() * gradient_).eval());
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

}  // namespace gantry::internal
