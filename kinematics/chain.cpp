#include "gantry/kinematics/chain.h"

#include <stdexcept>

namespace gantry {
namespace {

/// Covariance of a joint's frame error: a small twist at the axis point that tilts the direction and
/// shifts the axis, without the two motions (along and about the axis) that leave the axis where it is.
Matrix6d frame_error_covariance(const Joint& joint) {
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - joint.direction * joint.direction.transpose();
  Matrix6d local = Matrix6d::Zero();
  local.topLeftCorner<3, 3>() = joint.direction_sigma_rad * joint.direction_sigma_rad * across;
  if (joint.kind == JointKind::kRevolute)
    local.bottomRightCorner<3, 3>() = joint.point_sigma_mm * joint.point_sigma_mm * across;
  Pose base_from_axis = Pose::Identity();
  base_from_axis.translation() = joint.point_mm;
  const Matrix6d a = adjoint(base_from_axis);
  return a * local * a.transpose();
}

}  // namespace

Vector6d Joint::twist() const {
  Vector6d s;
  if (kind == JointKind::kPrismatic) {
    s << Eigen::Vector3d::Zero(), direction;
  } else {
    s << direction, point_mm.cross(direction);
  }
  return s;
}

Pose Chain::base_from_part(std::span<const double> q) const {
  if (q.size() != joints.size()) throw std::invalid_argument("Chain: one value for each joint is needed");
  Pose pose = Pose::Identity();
  for (size_t i = 0; i < joints.size(); ++i) pose = pose * pose_exp(joints[i].twist() * q[i]);
  return pose * base_from_part_at_zero;
}

Pose Chain::part_from_sensor(std::span<const double> q) const {
  return base_from_part(q).inverse() * base_from_sensor;
}

Eigen::Matrix<double, 6, Eigen::Dynamic> Chain::joint_jacobian(std::span<const double> q) const {
  // With base_from_part = A exp(S q) C, a step dq of this joint changes part_from_sensor on its left by
  // exp(-Ad(C^-1) S dq).
  Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian(6, static_cast<Eigen::Index>(joints.size()));
  Pose after = base_from_part_at_zero;
  for (size_t i = joints.size(); i-- > 0;) {
    jacobian.col(static_cast<Eigen::Index>(i)) = -adjoint(after.inverse()) * joints[i].twist();
    after = pose_exp(joints[i].twist() * q[i]) * after;
  }
  return jacobian;
}

UncertainPose Chain::uncertain_part_from_sensor(std::span<const double> q) const {
  UncertainPose result;
  result.mean = part_from_sensor(q);
  const auto jacobian = joint_jacobian(q);
  for (size_t i = 0; i < joints.size(); ++i) {
    const Vector6d column = jacobian.col(static_cast<Eigen::Index>(i));
    result.independent += joints[i].repeatability * joints[i].repeatability * column * column.transpose();
  }
  // A frame error e of joint i turns exp(S q) into exp(e) exp(S q) exp(-e); to first order the error of
  // part_from_sensor is Ad(C^-1) (I - Ad(exp(-S q))) e.
  Pose after = base_from_part_at_zero;
  for (size_t i = joints.size(); i-- > 0;) {
    const Pose motion = pose_exp(joints[i].twist() * q[i]);
    const Matrix6d j = adjoint(after.inverse()) * (Matrix6d::Identity() - adjoint(motion.inverse()));
    result.shared += j * frame_error_covariance(joints[i]) * j.transpose();
    after = motion * after;
  }
  Matrix6d mounting = Matrix6d::Zero();
  mounting.topLeftCorner<3, 3>().diagonal().setConstant(sensor_rotation_sigma_rad *
                                                        sensor_rotation_sigma_rad);
  mounting.bottomRightCorner<3, 3>().diagonal().setConstant(sensor_position_sigma_mm *
                                                            sensor_position_sigma_mm);
  const Matrix6d a = adjoint(result.mean);
  result.shared += a * mounting * a.transpose();
  return result;
}

}  // namespace gantry
