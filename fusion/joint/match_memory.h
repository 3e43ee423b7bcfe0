#pragma once

#include <map>
#include <utility>
#include <vector>

#include "joint/coarse.h"
#include "joint/edge_matches.h"
#include "joint/matches.h"

namespace gantry::internal {

struct JointProblem;

/// What the matches of one ordered pair of scans say, kind by kind, before they are put together.
struct RawSums {
  PairSum surfaces;
  EdgeSums edges, faces;
};

/// What matching found for pairs of scans, for as long as they keep their places relative to each other. In
/// a large set most scans rest while a few still look for their place, or are pushed on purpose: only their
/// pairs are matched again.
class MatchMemory {
 public:
  /// The raw sums of this pair, if it has moved by less than a tenth of the noise
  /// since it was matched, with the same stride and a loss at most as wide. Residuals follow the motion to
  /// first order.
  bool recall(const JointProblem& problem, size_t target, size_t source, const Poses& poses,
              const MatchGates& gates, RawSums& sums) const;
  void keep(size_t target, size_t source, const Poses& poses, const MatchGates& gates, const RawSums& sums);

 private:
  struct Matched {
    Pose target_from_source;
    MatchGates gates;
    RawSums sums;
  };
  std::map<std::pair<size_t, size_t>, Matched> matched_;  ///< By target and source.
};

}  // namespace gantry::internal
