#pragma once

#include <vector>

#include "joint/coarse.h"
#include "joint/match_memory.h"
#include "joint/matches.h"

namespace gantry::internal {

struct JointProblem;

/// What a round of matching saw of edges.
struct EdgeEvidence {
  EdgeModel model;  ///< As these matches show.
  /// For each slot, what edges and faces have added to PairSum::hessian.
  std::vector<Matrix6d> hessians;
  /// The normal equations of EdgeModel::break_mm, which is one more unknown: for each slot its mixed
  /// derivative with the error of the source; its own derivatives.
  std::vector<Vector6d> by_break;
  double break_hessian = 1, break_gradient = 0;
};

/// The model with what is not known of it (scatter of 0) taken from these matches, of all slots.
EdgeModel edge_model(const JointProblem& problem, const std::vector<RawSums>& raw, EdgeModel model);

/// Weighs edges and faces against surfaces whose residuals have `surface_variance` and of which one in
/// `stride` rows and columns was matched: adds what each slot's edges say to its sums, and returns it. Of the
/// edges of slot k one in edge_steps[k] was matched.
EdgeEvidence add_edges(const std::vector<RawSums>& raw, const EdgeModel& model, double surface_variance,
                       int stride, const std::vector<size_t>& edge_steps, std::vector<PairSum>& sums);

/// EdgeEvidence::by_break of all scans, 6 rows each.
Eigen::VectorXd by_break(const JointProblem& problem, const Pairs& pairs, const EdgeEvidence& edges);

/// EdgeModel::break_mm once this step has been applied to the poses at which the edges were matched.
double broken_after(const JointProblem& problem, const Pairs& pairs, const EdgeEvidence& edges,
                    const Eigen::VectorXd& step);

}  // namespace gantry::internal
