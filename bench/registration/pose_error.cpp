#include "pose_error.h"

#include <algorithm>

namespace gantry::bench {

PoseError pose_error(const ScanSet& set, std::span<const UncertainPose> initial,
                     std::span<const Pose> found) {
  PoseError error;
  const Pose gauge = set.truth[0] * found[0].inverse();
  for (size_t i = 1; i < found.size(); ++i) {
    const Pose estimated = gauge * found[i], inverse_initial = initial[i].mean.inverse();
    const Eigen::Matrix4d difference =
        (estimated * inverse_initial).matrix() - (set.truth[i] * inverse_initial).matrix();
    error.mae16 += difference.cwiseAbs().mean() / static_cast<double>(found.size() - 1);
    for (const Eigen::Vector3d& p : set.probes[i])
      error.dmax_mm = std::max(error.dmax_mm, (estimated * p - set.truth[i] * p).norm());
  }
  return error;
}

}  // namespace gantry::bench
