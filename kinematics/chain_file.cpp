#include "gantry/kinematics/chain_file.h"

#include <numbers>

namespace gantry {

Joint read_joint(StrictYaml joint, const std::string& name) {
  Joint result;
  result.name = name;
  const bool prismatic = joint.choice("kind", {"prismatic", "revolute"}) == "prismatic";
  result.kind = prismatic ? JointKind::kPrismatic : JointKind::kRevolute;
  const Eigen::Vector3d direction = joint.vector3("direction");
  if (direction.norm() < 1e-9) joint.fail("direction", "expected a vector that is not zero");
  result.direction = direction.normalized();
  if (prismatic) {
    result.repeatability = joint.number("repeatability_mm", {0, 1});
  } else {
    result.point_mm = joint.vector3("point_mm");
    result.repeatability = joint.angle_deg("repeatability_deg", {0, 1});
    result.point_sigma_mm = joint.number("point_sigma_mm", {0, 10});
  }
  result.direction_sigma_rad = joint.angle_deg("direction_sigma_deg", {0, 10});
  joint.finish();
  return result;
}

Pose read_pose(StrictYaml& pose) {
  const Eigen::Vector3d rpy_deg = pose.vector3("rotation_rpy_deg");
  return pose_from_position_rpy(pose.vector3("position_mm"), rpy_deg * (std::numbers::pi / 180.0));
}

}  // namespace gantry
