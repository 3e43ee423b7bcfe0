#include "joint/match_all.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

constexpr int kBandRows = 128;
/// Broken and rounded edges differ by this, in pitches, with the side they are seen from.
constexpr double kEdgeScatter_px = 3;
/// Edges of a scan that take part while pixels are skipped.
constexpr size_t kEdgeSamples = 400;

EdgeGates edge_gates(const JointProblem& problem, const RangeSurface& source, const MatchGates& gates) {
  EdgeGates edge;
  edge.scale_mm = std::max(gates.scale_mm, kEdgeScatter_px * problem.spacing_mm);
  edge.reach_mm = 2 * edge.scale_mm;
  edge.break_mm = gates.edges.break_mm;
  edge.normal_variance = 2 * problem.normal_variance;
  if (gates.stride > 1) edge.step = std::max<size_t>(1, source.edges.size() / problem.samples(kEdgeSamples));
  return edge;
}

/// A band of rows of a slot's source, or its edges.
struct Task {
  static constexpr int kEdges = -1;  ///< Instead of a first row.
  size_t slot;
  int first, last;
};

/// Edges first: they are few and take long.
std::vector<Task> tasks_for(const JointProblem& problem, const Slots& slots, int stride,
                            const std::vector<unsigned char>& remembered) {
  std::vector<Task> tasks;
  for (size_t slot = 0; slot < slots.count(); ++slot)
    if (!remembered[slot]) tasks.push_back({slot, Task::kEdges, Task::kEdges});
  const int band = std::max(kBandRows, 32 * stride);
  for (size_t slot = 0; slot < slots.count(); ++slot) {
    if (remembered[slot]) continue;
    const int height = problem.scans[slots.source(slot)].height;
    for (int row = 0; row < height; row += band) tasks.push_back({slot, row, std::min(height, row + band)});
  }
  return tasks;
}

std::vector<ActiveBlocks> no_active_blocks(const JointProblem& problem, const Slots& slots) {
  std::vector<ActiveBlocks> active(slots.count());
  for (size_t slot = 0; slot < slots.count(); ++slot) {
    const RangeSurface& s = problem.scans[slots.source(slot)];
    active[slot].active.assign(
        static_cast<size_t>(ActiveBlocks::across(s.width)) * ActiveBlocks::across(s.height), 0);
  }
  return active;
}

/// Variance of a surface's residual, over all matches; not so small that edges would count for nothing.
double surface_variance(const JointProblem& problem, const std::vector<RawSums>& raw) {
  double cost = 0, weight = 0;
  for (const RawSums& r : raw) {
    cost += r.surfaces.cost;
    weight += r.surfaces.weight;
  }
  return std::max(weight > 0 ? cost / weight : 0, std::pow(0.1 * problem.noise_mm, 2));
}

}  // namespace

std::vector<PairSum> match_all(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                               const MatchGates& gates, std::vector<std::vector<BlockSum>>* blocks,
                               std::vector<ActiveBlocks>* active, EdgeEvidence* edge_evidence,
                               MatchMemory* memory) {
  const Slots slots{pairs};
  std::vector<RawSums> raw(slots.count());
  std::vector<unsigned char> remembered(slots.count(), 0);
  for (size_t slot = 0; memory && slot < slots.count(); ++slot)
    remembered[slot] =
        memory->recall(problem, slots.target(slot), slots.source(slot), poses, gates, raw[slot]);
  const std::vector<Task> tasks = tasks_for(problem, slots, gates.stride, remembered);
  const bool use = active && !active->empty(), fill = active && active->empty();
  if (fill) *active = no_active_blocks(problem, slots);

  std::vector<PairSum> partial(tasks.size());
  std::vector<std::vector<BlockSum>> of_blocks(blocks ? tasks.size() : 0);
  tbb::parallel_for(size_t{0}, tasks.size(), [&](size_t t) {
    const Task& task = tasks[t];
    const size_t a = slots.target(task.slot), b = slots.source(task.slot);
    const RangeSurface &target = problem.scans[a], &source = problem.scans[b];
    const Pose target_from_source = poses[a].inverse() * poses[b];
    if (task.first == Task::kEdges) {
      const EdgeGates edge = edge_gates(problem, source, gates);
      raw[task.slot].edges =
          match_edges(target, problem.edges[a], source, target_from_source, poses[a], problem.centre, edge);
      raw[task.slot].faces =
          match_edges_to_faces(target, source, target_from_source, poses[a], problem.centre, edge);
      return;
    }
    partial[t] =
        match_by_projection(target, source, target_from_source, poses[a], problem.centre, gates, task.first,
                            task.last, blocks ? &of_blocks[t] : nullptr,
                            use ? &(*active)[task.slot] : nullptr, fill ? &(*active)[task.slot] : nullptr);
  });
  for (size_t t = 0; t < tasks.size(); ++t)
    if (tasks[t].first != Task::kEdges) raw[tasks[t].slot].surfaces += partial[t];
  for (size_t slot = 0; memory && slot < slots.count(); ++slot)
    if (!remembered[slot]) memory->keep(slots.target(slot), slots.source(slot), poses, gates, raw[slot]);

  // What becomes of each slot's gradients and Hessians; blocks follow.
  std::vector<PairSum> sums(slots.count());
  std::vector<Matrix6d> factors(slots.count());
  std::vector<double> softening(slots.count());
  std::vector<size_t> edge_steps(slots.count());
  for (size_t slot = 0; slot < slots.count(); ++slot) {
    sums[slot] = raw[slot].surfaces;
    softening[slot] = sums[slot].soften();
    factors[slot] = sums[slot].take_out_tilts();
    edge_steps[slot] = edge_gates(problem, problem.scans[slots.source(slot)], gates).step;
  }
  EdgeEvidence evidence = add_edges(raw, edge_model(problem, raw, gates.edges),
                                    surface_variance(problem, raw), gates.stride, edge_steps, sums);
  if (edge_evidence) *edge_evidence = std::move(evidence);
  if (!blocks) return sums;
  blocks->assign(slots.count(), {});
  for (size_t t = 0; t < tasks.size(); ++t) {
    const size_t slot = tasks[t].slot;
    const Eigen::Matrix<float, 6, 6> factor = factors[slot].cast<float>();
    for (BlockSum block : of_blocks[t]) {
      const Eigen::Matrix<float, 6, 6> hessian = static_cast<float>(softening[slot]) * factor * block.hessian;
      block.gradient = factor * block.gradient;
      block.hessian = 0.5f * (hessian + hessian.transpose());
      (*blocks)[slot].push_back(block);
    }
  }
  return sums;
}

}  // namespace gantry::internal
