#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace gantry {

/// A rigid transform named target first: `part_from_sensor * p_sensor = p_part`. Translation in mm.
using Pose = Eigen::Isometry3d;

/// A small motion: rotation vector (rad) in rows 0-2, translation (mm) in rows 3-5.
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Skew-symmetric matrix: cross_matrix(a) * b = a x b.
Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& a);

/// Rotation vector (axis times angle, rad) to rotation matrix, and back for angles up to pi.
Eigen::Matrix3d rotation_exp(const Eigen::Vector3d& rotation_vector);
Eigen::Vector3d rotation_log(const Eigen::Matrix3d& rotation);

/// The exponential map of SE(3): the motion after following the constant twist for unit time.
Pose pose_exp(const Vector6d& twist);
/// Inverse of pose_exp for rotations up to pi.
Vector6d pose_log(const Pose& pose);

/// The adjoint: pose * pose_exp(x) = pose_exp(adjoint(pose) * x) * pose.
Matrix6d adjoint(const Pose& pose);

/// From position and fixed-axis roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll), angles in rad.
Pose pose_from_position_rpy(const Eigen::Vector3d& position_mm, const Eigen::Vector3d& rpy_rad);

/// Angle of the rotation between two poses (rad), and distance of their origins (mm).
double rotation_distance(const Pose& a, const Pose& b);
double translation_distance(const Pose& a, const Pose& b);

/// A pose with its uncertainty. The true pose is pose_exp(error) * mean, where `error` has the given
/// covariance: errors live in the *target* frame (for part_from_sensor: rotations about the part's
/// origin). The covariance has two parts, because views of one run share the first but not the second:
/// `shared` comes from parameters common to all views (calibrated geometry, sensor mounting),
/// `independent` from what is drawn anew at every move (repeatability).
struct UncertainPose {
  Pose mean = Pose::Identity();
  Matrix6d shared = Matrix6d::Zero();
  Matrix6d independent = Matrix6d::Zero();

  Matrix6d covariance() const { return shared + independent; }
};

/// Standard deviation (mm) of where a point lands that is carried by a pose with this covariance:
/// the square root of the largest eigenvalue of the point's 3x3 covariance. `point` is in the target frame.
double point_sigma_mm(const Matrix6d& covariance, const Eigen::Vector3d& point);

}  // namespace gantry
