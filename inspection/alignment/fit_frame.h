#pragma once

#include "gantry/geometry/pose.h"

namespace gantry::internal {

/// Small motions with all six coordinates in mm: rotation vector about `centre` times `lever_mm`, then the
/// displacement of the centre. Rotations about a far origin would look like translations.
struct FitFrame {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  double lever_mm = 1;

  /// By how much such a motion moves a point along a direction.
  Vector6d row(const Eigen::Vector3d& point, const Eigen::Vector3d& direction) const {
    Vector6d j;
    j << (point - centre).cross(direction) / lever_mm, direction;
    return j;
  }
  /// To a twist about the origin.
  Matrix6d twist_from_local() const {
    Matrix6d t = Matrix6d::Identity();
    t.topLeftCorner<3, 3>() /= lever_mm;
    t.bottomLeftCorner<3, 3>() = cross_matrix(centre) / lever_mm;
    return t;
  }
  Pose motion(const Vector6d& local) const {
    Pose pose = Pose::Identity();
    pose.linear() = rotation_exp(local.head<3>() / lever_mm);
    pose.translation() = centre + local.tail<3>() - pose.linear() * centre;
    return pose;
  }
};

}  // namespace gantry::internal
