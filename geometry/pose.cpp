#include "gantry/geometry/pose.h"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace gantry {
namespace {

// Below this angle the closed forms lose digits to cancellation; the series is exact to double precision.
constexpr double kSmallAngle = 1e-4;

/// The left Jacobian of SO(3): maps the twist's linear part to the translation of its exponential.
Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  const Eigen::Matrix3d k = cross_matrix(w);
  double a = 0.5 - angle * angle / 24.0;
  double b = 1.0 / 6.0 - angle * angle / 120.0;
  if (angle > kSmallAngle) {
    a = (1.0 - std::cos(angle)) / (angle * angle);
    b = (angle - std::sin(angle)) / (angle * angle * angle);
  }
  return Eigen::Matrix3d::Identity() + a * k + b * k * k;
}

}  // namespace

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& a) {
  Eigen::Matrix3d m;
  m << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return m;
}

Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& rotation_vector) {
  const double angle = rotation_vector.norm();
  const Eigen::Matrix3d k = cross_matrix(rotation_vector);
  double a = 1.0 - angle * angle / 6.0;
  double b = 0.5 - angle * angle / 24.0;
  if (angle > kSmallAngle) {
    a = std::sin(angle) / angle;
    b = (1.0 - std::cos(angle)) / (angle * angle);
  }
  return Eigen::Matrix3d::Identity() + a * k + b * k * k;
}

Eigen::Vector3d rotation_log(const Eigen::Matrix3d& rotation) {
  // By way of the quaternion, which stays accurate near 0 and near pi.
  Eigen::Quaterniond q(rotation);
  q.normalize();
  if (q.w() < 0) q.coeffs() *= -1.0;
  const double sine = q.vec().norm();
  if (sine < 1e-12) return 2.0 * q.vec();
  return 2.0 * std::atan2(sine, q.w()) / sine * q.vec();
}

Pose pose_exp(const Vector6d& twist) {
  Pose pose = Pose::Identity();
  pose.linear() = rotation_exp(twist.head<3>());
  pose.translation() = left_jacobian(twist.head<3>()) * twist.tail<3>();
  return pose;
}

Vector6d pose_log(const Pose& pose) {
  Vector6d twist;
  twist.head<3>() = rotation_log(pose.linear());
  twist.tail<3>() = left_jacobian(twist.head<3>()).inverse() * pose.translation();
  return twist;
}

Matrix6d adjoint(const Pose& pose) {
  Matrix6d m = Matrix6d::Zero();
  m.topLeftCorner<3, 3>() = pose.linear();
  m.bottomRightCorner<3, 3>() = pose.linear();
  m.bottomLeftCorner<3, 3>() = cross_matrix(pose.translation()) * pose.linear();
  return m;
}

Pose pose_from_position_rpy(const Eigen::Vector3d& position_mm, const Eigen::Vector3d& rpy_rad) {
  Pose pose = Pose::Identity();
  pose.linear() = (Eigen::AngleAxisd(rpy_rad.z(), Eigen::Vector3d::UnitZ()) *
                   Eigen::AngleAxisd(rpy_rad.y(), Eigen::Vector3d::UnitY()) *
                   Eigen::AngleAxisd(rpy_rad.x(), Eigen::Vector3d::UnitX()))
                      .toRotationMatrix();
  pose.translation() = position_mm;
  return pose;
}

double rotation_distance(const Pose& a, const Pose& b) {
  return rotation_log(a.linear().transpose() * b.linear()).norm();
}

double translation_distance(const Pose& a, const Pose& b) {
  return (a.translation() - b.translation()).norm();
}

double point_sigma_mm(const Matrix6d& covariance, const Eigen::Vector3d& point) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -cross_matrix(point), Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d point_covariance = jacobian * covariance * jacobian.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(point_covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()(2)));
}

}  // namespace gantry
