#include "joint/match_memory.h"

#include "joint/problem.h"

namespace gantry::internal {
namespace {

/// Of the noise: within it residuals are linear in the motion.
constexpr double kAtRest = 0.1;
/// The loss narrows a little in every round, long after it has stopped to matter.
constexpr double kSameScale = 1.03;

}  // namespace

bool MatchMemory::recall(const JointProblem& problem, size_t target, size_t source, const Poses& poses,
                         const MatchGates& gates, PairSum& surfaces, PairSum& edges) const {
  const auto found = matched_.find({target, source});
  if (found == matched_.end()) return false;
  const Matched& then = found->second;
  if (then.gates.stride != gates.stride || then.gates.scale_mm > kSameScale * gates.scale_mm ||
      then.gates.max_angle_rad > gates.max_angle_rad)
    return false;
  // Of the source, the target held.
  const Vector6d motion =
      log_about(problem.centre, poses[source] * (poses[target] * then.target_from_source).inverse());
  const double moved_mm = motion.tail<3>().norm() + problem.radius_mm * motion.head<3>().norm();
  if (moved_mm > kAtRest * problem.noise_mm) return false;
  surfaces = then.surfaces;
  surfaces.gradient += surfaces.hessian * motion;
  edges = then.edges;
  edges.gradient += edges.hessian * motion;
  return true;
}

void MatchMemory::keep(size_t target, size_t source, const Poses& poses, const MatchGates& gates,
                       const PairSum& surfaces, const PairSum& edges) {
  matched_[{target, source}] = {poses[target].inverse() * poses[source], gates, surfaces, edges};
}

}  // namespace gantry::internal
