#include "gantry/kinematics/inverse.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

constexpr double kDirectionLever_mm = 100.0;
constexpr int kStartsPerJoint = 5;

/// Error in mm: position, then direction times its lever.
Vector6d view_error(const Pose& part_from_sensor, const ViewTarget& target) {
  Vector6d error;
  error.head<3>() = part_from_sensor.translation() - target.sensor_position_mm;
  error.tail<3>() = kDirectionLever_mm * (part_from_sensor.linear().col(2) - target.viewing_direction);
  return error;
}

double refine(const Chain& chain, const ViewTarget& target, std::span<const double> lower,
              std::span<const double> upper, std::vector<double>& q) {
  const auto n = static_cast<Eigen::Index>(q.size());
  double damping = 1e-2;
  Vector6d error = view_error(chain.part_from_sensor(q), target);
  for (int iteration = 0; iteration < 100 && damping < 1e8; ++iteration) {
    const Pose pose = chain.part_from_sensor(q);
    const auto twist = chain.joint_jacobian(q);
    Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian(6, n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Eigen::Vector3d w = twist.col(i).head<3>(), v = twist.col(i).tail<3>();
      jacobian.col(i).head<3>() = v + w.cross(pose.translation());
      jacobian.col(i).tail<3>() = kDirectionLever_mm * w.cross(pose.linear().col(2));
    }
    Eigen::MatrixXd hessian = jacobian.transpose() * jacobian;
    hessian.diagonal() *= 1 + damping;
    hessian.diagonal().array() += 1e-12;
    const Eigen::VectorXd step = hessian.ldlt().solve(-jacobian.transpose() * error);
    std::vector<double> next = q;
    for (Eigen::Index i = 0; i < n; ++i) next[i] = std::clamp(q[i] + step[i], lower[i], upper[i]);
    const Vector6d next_error = view_error(chain.part_from_sensor(next), target);
    if (next_error.squaredNorm() < error.squaredNorm()) {
      const bool settled = error.squaredNorm() - next_error.squaredNorm() < 1e-16;
      q = next;
      error = next_error;
      damping = std::max(1e-9, damping / 5);
      if (settled) break;
    } else {
      damping *= 5;
    }
  }
  return error.squaredNorm();
}

}  // namespace

InverseResult nearest_view(const Chain& chain, const ViewTarget& target, std::span<const double> lower,
                           std::span<const double> upper) {
  const size_t n = chain.joints.size();
  size_t starts = 1;
  for (size_t i = 0; i < n; ++i) starts *= kStartsPerJoint;
  InverseResult best;
  double best_cost = 1e300;
  for (size_t s = 0; s < starts; ++s) {
    std::vector<double> q(n);
    size_t rest = s;
    for (size_t i = 0; i < n; ++i, rest /= kStartsPerJoint)
      q[i] = lower[i] +
             (upper[i] - lower[i]) * (static_cast<double>(rest % kStartsPerJoint) + 0.5) / kStartsPerJoint;
    const double cost = refine(chain, target, lower, upper, q);
    if (cost < best_cost - 1e-12) {
      best_cost = cost;
      best.q = q;
    }
  }
  const Pose pose = chain.part_from_sensor(best.q);
  best.position_error_mm = (pose.translation() - target.sensor_position_mm).norm();
  best.direction_error_rad =
      std::acos(std::clamp(pose.linear().col(2).dot(target.viewing_direction), -1.0, 1.0));
  return best;
}

}  // namespace gantry
