#include "gantry/kinematics/chain.h"

#include <stdexcept>

namespace gantry {
namespace {

/// About the half width of a part: systematic errors of the sensor differ by their own size over it.
constexpr double kSystematicLever_mm = 100;

/// What a joint's calibrated geometry may be wrong by: small twists of its frame, one column for each
/// parameter, one standard deviation long. The direction tilts and the axis shifts, each in two ways across
/// the direction: along and about the axis there is nothing to be wrong. A parameter that is known exactly
/// has no column.
SharedFactor frame_errors(const Joint& joint) {
  const Eigen::Vector3d across[2] = {joint.direction.unitOrthogonal(),
                                     joint.direction.cross(joint.direction.unitOrthogonal())};
  SharedFactor columns(6, 0);
  const auto add = [&](const Eigen::Vector3d& rotation, const Eigen::Vector3d& shift) {
    columns.conservativeResize(6, columns.cols() + 1);
    columns.rightCols<1>() << rotation, shift;
  };
  if (joint.direction_sigma_rad > 0)
    for (const Eigen::Vector3d& v : across) add(joint.direction_sigma_rad * v, Eigen::Vector3d::Zero());
  if (joint.kind == JointKind::kRevolute && joint.point_sigma_mm > 0)
    for (const Eigen::Vector3d& v : across) add(Eigen::Vector3d::Zero(), joint.point_sigma_mm * v);
  Pose base_from_axis = Pose::Identity();
  base_from_axis.translation() = joint.point_mm;
  return adjoint(base_from_axis) * columns;
}

/// The same for the sensor's mounting, as twists of the sensor's frame.
SharedFactor mounting_errors(const Chain& chain) {
  SharedFactor columns(6, 0);
  for (int k = 0; k < 6; ++k) {
    const double sigma = k < 3 ? chain.sensor_rotation_sigma_rad : chain.sensor_position_sigma_mm;
    if (!(sigma > 0)) continue;
    columns.conservativeResize(6, columns.cols() + 1);
    columns.rightCols<1>() = sigma * Vector6d::Unit(k);
  }
  return columns;
}

void append(SharedFactor& factor, const SharedFactor& columns) {
  factor.conservativeResize(6, factor.cols() + columns.cols());
  factor.rightCols(columns.cols()) = columns;
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
  const double shift_mm = sensor_systematic_sigma_mm, turn_rad = shift_mm / kSystematicLever_mm;
  result.independent.diagonal().head<3>().array() += turn_rad * turn_rad;
  result.independent.diagonal().tail<3>().array() += shift_mm * shift_mm;
  // A frame error e of joint i turns exp(S q) into exp(e) exp(S q) exp(-e); to first order the error of
  // part_from_sensor is Ad(C^-1) (I - Ad(exp(-S q))) e.
  std::vector<SharedFactor> of_joints(joints.size());
  Pose after = base_from_part_at_zero;
  for (size_t i = joints.size(); i-- > 0;) {
    const Pose motion = pose_exp(joints[i].twist() * q[i]);
    const Matrix6d j = adjoint(after.inverse()) * (Matrix6d::Identity() - adjoint(motion.inverse()));
    of_joints[i] = j * frame_errors(joints[i]);
    after = motion * after;
  }
  for (const SharedFactor& columns : of_joints) append(result.shared_factor, columns);
  append(result.shared_factor, adjoint(result.mean) * mounting_errors(*this));
  return result;
}

}  // namespace gantry
