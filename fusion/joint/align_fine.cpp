#include "joint/align_fine.h"

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

/// Until it is known how well edges are placed, this is supposed, in pitches.
constexpr double kEdgeSigmaAtFirst_px = 1;

}  // namespace

NormalEquations equations_of(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                             const std::vector<PairSum>& sums, const EdgeEvidence& edges, double sigma_mm) {
  NormalEquations equations(problem.size());
  const double factor = 1 / (sigma_mm * sigma_mm);
  for (size_t k = 0; k < pairs.size(); ++k) {
    equations.add_pair(pairs[k].first, pairs[k].second, sums[2 * k], factor);
    equations.add_pair(pairs[k].second, pairs[k].first, sums[2 * k + 1], factor);
  }
  equations.eliminate(by_break(problem, pairs, edges), edges.break_hessian, edges.break_gradient, factor);
  equations.add_prior(problem.tag_prior.information(), errors_of_tags(problem, poses));
  return equations;
}

FineResult align_fine(const JointProblem& problem, const Pairs& pairs, const FineOptions& options,
                      Poses& poses, std::vector<ActiveBlocks>* active) {
  constexpr double kShrink = 0.5;
  size_t usable = 0;
  for (const RangeSurface& s : problem.scans) usable += s.usable;
  MatchGates gates;
  gates.stride = std::max(1, static_cast<int>(std::lround(std::sqrt(
                                 static_cast<double>(usable) /
                                 static_cast<double>(problem.size() * problem.samples(options.samples))))));
  if (active) gates.stride = std::min(gates.stride, 4);
  gates.normal_variance = problem.normal_variance;
  gates.edges = options.edges;
  FineResult result;
  double scale = options.start_mm;
  const double least = 3 * 1.4142 * problem.noise_mm;
  result.sigma_mm = problem.noise_mm;
  bool at_end = false;
  MatchMemory own;
  MatchMemory* memory = !problem.many() ? nullptr : options.memory ? options.memory : &own;
  for (int round = 0; round < options.max_rounds; ++round) {
    gates.scale_mm = scale;
    gates.reach_mm = 3 * scale;
    gates.max_angle_rad = at_end ? 0.35 : 0.5236;
    if (!(options.edges.at_edges.sigma_mm > 0)) {
      const double sigma_mm = at_end ? 0 : kEdgeSigmaAtFirst_px * problem.spacing_mm;
      gates.edges.at_edges = gates.edges.at_faces = {sigma_mm, sigma_mm, sigma_mm};
    }
    EdgeEvidence edges;
    const std::vector<PairSum> sums =
        match_all(problem, pairs, poses, gates, nullptr, active, &edges, memory);
    result.edges = edges.model;
    double cost = 0, weight = 0;
    for (const PairSum& s : sums) {
      cost += s.cost;
      weight += s.weight;
    }
    if (!(weight > 0)) break;
    result.sigma_mm = std::max(std::sqrt(cost / weight), 0.1 * problem.noise_mm);
    const Eigen::VectorXd step = equations_of(problem, pairs, poses, sums, edges, result.sigma_mm).solve();
    const double step_mm = apply_step(problem, step, poses);
    result.edges.break_mm = gates.edges.break_mm = broken_after(problem, pairs, edges, step);
    if (at_end && step_mm < 0.02 * problem.noise_mm) break;
    const double goal = std::max(least, 3 * result.sigma_mm);
    if (scale <= goal * 1.0001) at_end = true;
    scale = std::min(scale, std::max(goal, kShrink * scale));
  }
  return result;
}

}  // namespace gantry::internal
