#pragma once

#include <vector>

#include "joint/edge_evidence.h"
#include "joint/problem.h"

namespace gantry::internal {

/// One round of matching over `pairs`, surfaces and edges, both ways: sums for (target, source) of pairs[k]
/// at 2k, the other way round at 2k + 1. Edges count as much as their scatter allows: in a part that surfaces
/// hold in all directions they hardly matter, on a plate they are what keeps it from sliding. The sums'
/// weights and costs are those of surfaces alone. `blocks` (optional): those of surfaces, block by block for
/// each. `active` (optional, strides up to 4): filled when empty, used when not. `memory` (optional, not
/// together with blocks): pairs that have not moved since are not matched again.
std::vector<PairSum> match_all(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                               const MatchGates& gates, std::vector<std::vector<BlockSum>>* blocks = nullptr,
                               std::vector<ActiveBlocks>* active = nullptr,
                               EdgeEvidence* edge_evidence = nullptr, MatchMemory* memory = nullptr);

}  // namespace gantry::internal
