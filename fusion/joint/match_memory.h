#pragma once

#include <map>
#include <utility>
#include <vector>

#include "joint/coarse.h"
#include "joint/matches.h"

namespace gantry::internal {

struct JointProblem;

/// What matching found for pairs of scans, for as long as they keep their places relative to each other. In
/// a large set most scans rest while a few still look for their place, or are pushed on purpose: only their
/// pairs are matched again.
class MatchMemory {
 public:
  /// The raw sums over surfaces and edges of this pair, if it has moved by less than a tenth of the noise
  /// since it was matched, with the same stride and a loss at most as wide. Residuals follow the motion to
  /// first order.
  bool recall(const JointProblem& problem, size_t target, size_t source, const Poses& poses,
              const MatchGates& gates, PairSum& surfaces, PairSum& edges) const;
  void keep(size_t target, size_t source, const Poses& poses, const MatchGates& gates,
            const PairSum& surfaces, const PairSum& edges);

 private:
  struct Matched {
    Pose target_from_source;
    MatchGates gates;
    PairSum surfaces, edges;
  };
  std::map<std::pair<size_t, size_t>, Matched> matched_;  ///< By target and source.
};

}  // namespace gantry::internal
