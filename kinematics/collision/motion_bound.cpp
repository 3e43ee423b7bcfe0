#include "collision/motion_bound.h"

#include <algorithm>
#include <cmath>

namespace gantry {

// From the last joint downwards. What the joints above have done to the body is known in the middle of the
// stretch; on the rest of it they can carry a point by half of their own bound at most. Distance from an axis
// is a convex function, so its maximum over the box is at a corner.
MotionBound bound_motion(std::span<const Joint> joints, std::span<const double> q_from,
                         std::span<const double> q_to, std::span<const double> deviation, double begin,
                         double end, const Eigen::Matrix<double, 3, 8>& corners) {
  MotionBound bound;
  Eigen::Matrix<double, 3, 8> points = corners;
  const double middle = 0.5 * (begin + end);
  for (size_t j = joints.size(); j-- > 0;) {
    const Joint& joint = joints[j];
    double reach = 1;  // mm that a point moves per unit of the joint
    if (joint.kind == JointKind::kRevolute) {
      reach = 0;
      for (int k = 0; k < 8; ++k)
        reach = std::max(reach, joint.direction.cross(points.col(k) - joint.point_mm).norm());
      reach += 0.5 * (end - begin) * bound.speed_mm + bound.deviation_mm;
    }
    bound.speed_mm += std::abs(q_to[j] - q_from[j]) * reach;
    if (!deviation.empty()) bound.deviation_mm += deviation[j] * reach;
    const Pose motion = pose_exp(joint.twist() * (q_from[j] + middle * (q_to[j] - q_from[j])));
    points = (motion.linear() * points).colwise() + motion.translation();
  }
  return bound;
}

}  // namespace gantry
