#pragma once

#include <Eigen/Core>
#include <span>

#include "gantry/kinematics/chain.h"

namespace gantry {

/// How far the points of a body can move.
struct MotionBound {
  double speed_mm = 0;      ///< Largest displacement of any point per unit of the path parameter.
  double deviation_mm = 0;  ///< Largest displacement by joints that are off the path by their deviation.
};

/// Bounds the motion of a body (held by the box with these corners, base frame with all joints at zero) that
/// rides on `joints`, seen from what the first of them stands on, while these joints move from q_from +
/// begin * (q_to - q_from) to q_from + end * (q_to - q_from). `deviation`: of each of the joints, or empty.
MotionBound bound_motion(std::span<const Joint> joints, std::span<const double> q_from,
                         std::span<const double> q_to, std::span<const double> deviation, double begin,
                         double end, const Eigen::Matrix<double, 3, 8>& corners);

}  // namespace gantry
