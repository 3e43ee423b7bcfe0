#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "gantry/geometry/pose.h"

namespace gantry {

enum class JointKind { kPrismatic, kRevolute };

/// One joint of the stack of stages, described where it stands when all joints are at zero, in the
/// `base` frame. Values of a joint are mm (prismatic) or rad (revolute, right-handed about `direction`).
struct Joint {
  std::string name;
  JointKind kind = JointKind::kRevolute;
  Eigen::Vector3d direction =
      Eigen::Vector3d::UnitZ();  ///< Unit vector along the travel or the axis of rotation.
  Eigen::Vector3d point_mm =
      Eigen::Vector3d::Zero();  ///< A point on the axis of rotation; unused when prismatic.

  // Standard uncertainties, of which the pose's covariance is made.
  double repeatability = 0;        ///< mm or rad: drawn anew at every move.
  double direction_sigma_rad = 0;  ///< Of the calibrated direction, each of the two ways it can tilt.
  double point_sigma_mm = 0;       ///< Of the calibrated axis position, each of the two ways it can shift.

  /// The unit twist of the joint in the base frame (rotation first), see pose.h.
  Vector6d twist() const;
};

/// The kinematic chain of the cell. The joints stand on the base one upon the other, in the order
/// given; the part rides on the last one; the sensor is fixed to the base. By the product of
/// exponentials (Lynch and Park, Modern Robotics, 4.1):
///   base_from_part(q) = exp(S_1 q_1) ... exp(S_n q_n) base_from_part_at_zero
///   part_from_sensor(q) = base_from_part(q)^-1 base_from_sensor
struct Chain {
  std::vector<Joint> joints;
  Pose base_from_part_at_zero = Pose::Identity();
  Pose base_from_sensor = Pose::Identity();
  double sensor_position_sigma_mm = 0;   ///< Of the calibrated mounting, each axis.
  double sensor_rotation_sigma_rad = 0;  ///< About each axis through the sensor's origin.
  /// Of a measured point, common to its neighbours: what the sensor's own calibration leaves over. Every view
  /// sees the part through another part of the measuring volume, so that it displaces and turns each scan
  /// anew.
  double sensor_systematic_sigma_mm = 0;

  Pose base_from_part(std::span<const double> q) const;
  Pose part_from_sensor(std::span<const double> q) const;

  /// d(error of part_from_sensor)/dq, 6 x n; errors as in UncertainPose (target frame).
  Eigen::Matrix<double, 6, Eigen::Dynamic> joint_jacobian(std::span<const double> q) const;

  /// Forward kinematics with first-order covariance: repeatability and the sensor's systematic
  /// error make the independent part. Columns of
  /// the shared factor, where the sigma is not zero: of each joint two tilts of the direction and
  /// (revolute) two shifts of the axis; then rotations and shifts of the sensor, x y z each.
  UncertainPose uncertain_part_from_sensor(std::span<const double> q) const;
};

}  // namespace gantry
