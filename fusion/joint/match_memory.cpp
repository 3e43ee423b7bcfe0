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
                         const MatchGates& gates, RawSums& sums) const {
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
  sums = then.sums;
  const double broken_more_mm = gates.edges.break_mm - then.gates.edges.break_mm;
  for (PairSum& face : sums.faces) {
    face.gradient += broken_more_mm * face.directions;
    face.cost += broken_more_mm * (2 * face.offset + broken_more_mm * face.weight);
    face.offset += broken_more_mm * face.weight;
  }
  sums.surfaces.gradient += sums.surfaces.hessian * motion;
  for (EdgeSums* kind : {&sums.edges, &sums.faces})
    for (PairSum& sum : *kind) {
      sum.gradient += sum.hessian * motion;
      sum.offset += sum.directions.dot(motion);
    }
  return true;
}

void MatchMemory::keep(size_t target, size_t source, const Poses& poses, const MatchGates& gates,
                       const RawSums& sums) {
  matched_[{target, source}] = {poses[target].inverse() * poses[source], gates, sums};
}

}  // namespace gantry::internal
