#pragma once

#include <vector>

#include "joint/attempt.h"
#include "joint/covariance.h"

namespace gantry::internal {

/// The believed poses, brought to rest on all pixels, and how well they are known.
struct Solution {
  Poses poses;
  Pose gauge = Pose::Identity();  ///< Brings the first scan back to where it was tagged.
  double last_step_mm = 0;        ///< How far the last round moved any scan, at the part's radius.
  EdgeModel edges;
  Pairs pairs;                ///< Those of the attempt's evidence that take part, then those that do not.
  std::vector<PairSum> sums;  ///< Of both ways, as match_all's.
  TagPrior::ChiSquare from_tags;
  std::vector<double> leave_one_out_mm;  ///< How far the other scans would go without this one.
  /// Of errors about the centre, relative to the first scan, in the frame that `gauge` leads to; of scans
  /// that are left out as if they took part.
  std::vector<Matrix6d> covariance;
  /// The same of all scans at once, 6 n x 6 n, without those that are left out (their rows say nothing).
  Eigen::MatrixXd joint_covariance;
};

/// The last rounds of the scans that take part; those that are left out stay where the attempt saw them.
Solution solve_finely(const JointProblem& problem, const Attempt& attempt);

/// Whether the last round moved hardly anything.
bool at_rest(const JointProblem& problem, const Solution& solution);

/// What speaks against single scans in a solution, the most telling first.
Objections objections_to(const JointProblem& problem, const Attempt& attempt, const Solution& solution);
/// What speaks against all of it; empty: nothing.
std::string objection_to_all(const JointProblem& problem, const Attempt& attempt, const Solution& solution);

/// How the first scan and this one are held against each other, in words.
std::string observability_of(const JointProblem& problem, const Attempt& attempt, const Solution& solution,
                             size_t scan);

}  // namespace gantry::internal
