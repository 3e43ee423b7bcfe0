#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>

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

/// What the errors of several poses have in common, column by column, see UncertainPose.
using SharedFactor = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// A pose with its uncertainty. The true pose is pose_exp(error) * mean, where errors live in the *target*
/// frame (for part_from_sensor: rotations about the part's origin). An error has two parts, because views of
/// one run share the one but not the other:
///
///   error = shared_factor * z + own
///
/// z are the errors of the cell's calibrated parameters (directions and positions of axes, the sensor's
/// mounting), in units of their standard deviation and independent of each other: *one* z for all poses of a
/// calibration, whatever it is. So a column of `shared_factor` is how far one parameter, wrong by one sigma,
/// moves this pose; with parameters that are correlated it is the Jacobian times the Cholesky factor of their
/// covariance. `own` is drawn anew for every pose (repeatability) and has covariance `independent`.
///
/// The more of the error is shared, the better poses are known relative to each other: what one parameter
/// does to all of them cannot set one against another. Two poses may be compared column by column only if
/// these stand for the same parameters in the same order, which is what an equal `calibration_id` means.
struct UncertainPose {
  Pose mean = Pose::Identity();
  /// 6 x (number of parameters); 6 x 0 where nothing is known to be shared.
  SharedFactor shared_factor;
  Matrix6d independent = Matrix6d::Zero();
  std::string calibration_id;  ///< Of the parameters that the columns stand for; may be empty.

  Matrix6d shared() const { return shared_factor * shared_factor.transpose(); }
  Matrix6d covariance() const { return shared() + independent; }
};

/// Standard deviation (mm) of where a point lands that is carried by a pose with this covariance:
/// the square root of the largest eigenvalue of the point's 3x3 covariance. `point` is in the target frame.
double point_sigma_mm(const Matrix6d& covariance, const Eigen::Vector3d& point);

}  // namespace gantry
