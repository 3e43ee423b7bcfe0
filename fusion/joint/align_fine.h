#pragma once

#include "joint/match_all.h"
#include "joint/problem.h"

namespace gantry::internal {

/// Surfaces, edges and tags together; `sigma_mm` of a surface's residual.
NormalEquations equations_of(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                             const std::vector<PairSum>& sums, const EdgeEvidence& edges, double sigma_mm);

struct FineOptions {
  double start_mm = 1;    ///< Robust scale at the beginning.
  size_t samples = 5000;  ///< Of a scan, about; fewer where there are many.
  int max_rounds = 30;
  EdgeModel edges = {};  ///< Scatter of 0: as seen once the robust scale has shrunk.
  /// Used and brought up to date where there are many scans; null: nothing is remembered from earlier.
  MatchMemory* memory = nullptr;
};

struct FineResult {
  double sigma_mm = 0;  ///< Robust standard deviation of the residuals.
  EdgeModel edges;
};

/// Gauss-Newton with matches by projection; robust scale from the start down to three sigma of the
/// residuals. `active` as in match_all.
FineResult align_fine(const JointProblem& problem, const Pairs& pairs, const FineOptions& options,
                      Poses& poses, std::vector<ActiveBlocks>* active = nullptr);

}  // namespace gantry::internal
