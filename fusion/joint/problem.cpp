#include "joint/problem.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

constexpr int kBandRows = 128;
/// Pairs that agree in less than this fraction of what was tested share nothing worth matching.
constexpr double kLeastOverlap = 0.002;

/// An edge is not placed better than this by one of its pixels, in pitches ...
constexpr double kEdgeSigma_px = 0.3;
/// ... until it is known how well, this is supposed ...
constexpr double kEdgeSigmaAtFirst_px = 1;
/// ... and so many of them in a row say the same, because they share a window (surface_edges.h).
constexpr double kEdgePixelsAlike = 9;
/// Broken and rounded edges differ by this, in pitches, with the side they are seen from.
constexpr double kEdgeScatter_px = 3;
/// Edges of a scan that take part while pixels are skipped.
constexpr size_t kEdgeSamples = 400;

EdgeGates edge_gates(const JointProblem& problem, const RangeSurface& source, const MatchGates& gates) {
  EdgeGates edge;
  edge.scale_mm = std::max(gates.scale_mm, kEdgeScatter_px * problem.spacing_mm);
  edge.reach_mm = 2 * edge.scale_mm;
  if (gates.stride > 1) edge.step = std::max<size_t>(1, source.edges.size() / problem.samples(kEdgeSamples));
  return edge;
}

double variance_of(const std::vector<PairSum>& sums) {
  double cost = 0, weight = 0;
  for (const PairSum& s : sums) {
    cost += s.cost;
    weight += s.weight;
  }
  return weight > 0 ? cost / weight : 0;
}

}  // namespace

Pairs pairs_with_overlap(const JointProblem& problem, const Poses& poses, double tolerance_mm) {
  const size_t n = problem.size();
  const double samples = 3000 * problem.share_of_pair();
  std::vector<WeighedPair> candidates;
  for (size_t a = 0; a < n; ++a)
    for (size_t b = a + 1; b < n; ++b) candidates.push_back({a, b, 0});
  tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t k) {
    WeighedPair& c = candidates[k];
    for (const auto& [target, source] : {std::pair{c.a, c.b}, {c.b, c.a}}) {
      const RangeSurface& s = problem.scans[source];
      const int stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(s.usable) / samples)));
      const Agreement agreement =
          compare(problem.scans[target], s, poses[target].inverse() * poses[source], tolerance_mm, stride);
      const double all = static_cast<double>(s.usable) / (stride * stride);
      if (static_cast<double>(agreement.matched) > kLeastOverlap * all) c.weight += agreement.matched;
    }
  });
  return strongest_pairs(std::move(candidates), n, problem.max_partners);
}

std::vector<PairSum> match_all(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                               const MatchGates& gates, std::vector<std::vector<BlockSum>>* blocks,
                               std::vector<ActiveBlocks>* active, EdgeEvidence* edge_evidence,
                               MatchMemory* memory) {
  constexpr int kEdges = -1;  // instead of a first row
  struct Task {
    size_t slot, target, source;
    int first, last;
  };
  std::vector<PairSum> sums(2 * pairs.size()), edges(2 * pairs.size());
  std::vector<unsigned char> remembered(2 * pairs.size(), 0);
  std::vector<Task> tasks;
  for (size_t slot = 0; slot < 2 * pairs.size(); ++slot) {
    const auto& [a, b] = pairs[slot / 2];
    const size_t target = slot % 2 == 0 ? a : b, source = slot % 2 == 0 ? b : a;
    remembered[slot] =
        memory && memory->recall(problem, target, source, poses, gates, sums[slot], edges[slot]);
    if (remembered[slot]) continue;
    tasks.push_back({slot, target, source, kEdges, kEdges});
  }
  const int band = std::max(kBandRows, 32 * gates.stride);
  for (size_t k = 0; k < pairs.size(); ++k) {
    const auto& [a, b] = pairs[k];
    for (int way = 0; way < 2; ++way) {
      if (remembered[2 * k + static_cast<size_t>(way)]) continue;
      const size_t target = way == 0 ? a : b, source = way == 0 ? b : a;
      const int height = problem.scans[source].height;
      for (int row = 0; row < height; row += band)
        tasks.push_back(
            {2 * k + static_cast<size_t>(way), target, source, row, std::min(height, row + band)});
    }
  }
  const bool use = active && !active->empty(), fill = active && active->empty();
  if (fill) {
    active->resize(2 * pairs.size());
    for (const Task& task : tasks) {
      if (task.first == kEdges) continue;
      const RangeSurface& s = problem.scans[task.source];
      (*active)[task.slot].active.assign(
          static_cast<size_t>(ActiveBlocks::across(s.width)) * ActiveBlocks::across(s.height), 0);
    }
  }
  std::vector<PairSum> partial(tasks.size());
  std::vector<std::vector<BlockSum>> gradients(blocks ? tasks.size() : 0);
  tbb::parallel_for(size_t{0}, tasks.size(), [&](size_t t) {
    const Task& task = tasks[t];
    if (task.first == kEdges) {
      partial[t] = match_edges(
          problem.scans[task.target], problem.edges[task.target], problem.scans[task.source],
          poses[task.target].inverse() * poses[task.source], poses[task.target], problem.centre,
          edge_gates(problem, problem.scans[task.source], gates), blocks ? &gradients[t] : nullptr);
      return;
    }
    partial[t] =
        match_by_projection(problem.scans[task.target], problem.scans[task.source],
                            poses[task.target].inverse() * poses[task.source], poses[task.target],
                            problem.centre, gates, task.first, task.last, blocks ? &gradients[t] : nullptr,
                            use ? &(*active)[task.slot] : nullptr, fill ? &(*active)[task.slot] : nullptr);
  });
  for (size_t t = 0; t < tasks.size(); ++t)
    (tasks[t].first == kEdges ? edges : sums)[tasks[t].slot] += partial[t];
  for (size_t slot = 0; memory && slot < sums.size(); ++slot) {
    const auto& [a, b] = pairs[slot / 2];
    if (!remembered[slot])
      memory->keep(slot % 2 == 0 ? a : b, slot % 2 == 0 ? b : a, poses, gates, sums[slot], edges[slot]);
  }
  const double edge_sigma =
      gates.edge_sigma_mm > 0
          ? gates.edge_sigma_mm
          : std::max({std::sqrt(variance_of(edges)), problem.noise_mm, kEdgeSigma_px * problem.spacing_mm});
  // They count as their scatter allows, which tells sharp edges from broken ones.
  const double weight_of_edge = std::max(variance_of(sums), std::pow(0.1 * problem.noise_mm, 2)) /
                                (edge_sigma * edge_sigma * kEdgePixelsAlike);
  // What was skipped, of edges and of pixels, must not change how much they count against each other.
  const auto edge_factor = [&](size_t slot) {
    const auto& [a, b] = pairs[slot / 2];
    const size_t step = edge_gates(problem, problem.scans[slot % 2 == 0 ? b : a], gates).step;
    return weight_of_edge * static_cast<double>(step) / (gates.stride * gates.stride);
  };
  // What becomes of each slot's gradients and Hessians; blocks follow.
  std::vector<Matrix6d> factors(sums.size()), edge_factors(sums.size());
  std::vector<double> softening(sums.size());
  for (size_t slot = 0; slot < sums.size(); ++slot) {
    softening[slot] = sums[slot].soften();
    factors[slot] = sums[slot].take_out_tilts();
    edge_factors[slot] = edge_factor(slot) * edges[slot].take_out_tilts();
    sums[slot].hessian += edge_factor(slot) * edges[slot].hessian;
    sums[slot].gradient += edge_factor(slot) * edges[slot].gradient;
  }
  if (edge_evidence) {
    edge_evidence->sigma_mm = edge_sigma;
    edge_evidence->if_source_stood_out.clear();
    for (size_t slot = 0; slot < sums.size(); ++slot)
      edge_evidence->if_source_stood_out.push_back(edge_factors[slot] * edges[slot].directions);
  }
  if (blocks) {
    blocks->assign(sums.size(), {});
    for (size_t t = 0; t < tasks.size(); ++t) {
      auto& into = (*blocks)[tasks[t].slot];
      for (BlockSum block : gradients[t]) {
        const bool edge = tasks[t].first == kEdges;
        const size_t slot = tasks[t].slot;
        const Eigen::Matrix<float, 6, 6> factor = (edge ? edge_factors : factors)[slot].cast<float>();
        const Eigen::Matrix<float, 6, 6> hessian =
            (edge ? 1.0f : static_cast<float>(softening[slot])) * factor * block.hessian;
        block.gradient = factor * block.gradient;
        block.hessian = 0.5f * (hessian + hessian.transpose());
        into.push_back(block);
      }
    }
  }
  return sums;
}

Eigen::VectorXd errors_of_tags(const JointProblem& problem, const Poses& poses) {
  Eigen::VectorXd errors(static_cast<Eigen::Index>(6 * problem.size()));
  for (size_t i = 0; i < problem.size(); ++i)
    errors.segment<6>(static_cast<Eigen::Index>(6 * i)) =
        log_about(problem.centre, poses[i] * problem.priors[i].part_from_grid.inverse());
  return errors;
}

NormalEquations equations_of(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                             const std::vector<PairSum>& sums, double sigma_mm) {
  NormalEquations equations(problem.size());
  for (size_t k = 0; k < pairs.size(); ++k) {
    equations.add_pair(pairs[k].first, pairs[k].second, sums[2 * k], 1 / (sigma_mm * sigma_mm));
    equations.add_pair(pairs[k].second, pairs[k].first, sums[2 * k + 1], 1 / (sigma_mm * sigma_mm));
  }
  equations.add_prior(problem.tag_prior.information(), errors_of_tags(problem, poses));
  return equations;
}

double apply_step(const JointProblem& problem, const Eigen::VectorXd& step, Poses& poses) {
  double largest = 0;
  const Eigen::Matrix<double, 6, 1> first = step.head<6>();
  for (size_t i = 0; i < poses.size(); ++i) {
    const Vector6d twist = step.segment<6>(static_cast<Eigen::Index>(6 * i));
    poses[i] = exp_about(problem.centre, twist) * poses[i];
    const Vector6d relative = twist - first;
    largest = std::max(largest, relative.tail<3>().norm() + problem.radius_mm * relative.head<3>().norm());
  }
  return largest;
}

double difference_mm(const JointProblem& problem, const Poses& a, const Poses& b) {
  double largest = 0;
  const Pose common = a[0] * b[0].inverse();
  for (size_t i = 1; i < a.size(); ++i) {
    const Vector6d twist = log_about(problem.centre, common * b[i] * a[i].inverse());
    largest = std::max(largest, twist.tail<3>().norm() + problem.radius_mm * twist.head<3>().norm());
  }
  return largest;
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
  gates.normal_variance = problem.normal_variance;
  FineResult result;
  double scale = options.start_mm;
  const double least = 3 * 1.4142 * problem.noise_mm;
  result.sigma_mm = problem.noise_mm;
  bool at_end = false;
  MatchMemory own;
  MatchMemory* memory = !problem.many() ? nullptr : options.memory ? options.memory : &own;
  for (result.rounds = 0; result.rounds < options.max_rounds; ++result.rounds) {
    gates.scale_mm = scale;
    gates.reach_mm = 3 * scale;
    gates.max_angle_rad = at_end ? 0.35 : 0.5236;
    gates.edge_sigma_mm = options.edge_sigma_mm > 0 || at_end ? options.edge_sigma_mm
                                                              : kEdgeSigmaAtFirst_px * problem.spacing_mm;
    EdgeEvidence edges;
    const std::vector<PairSum> sums =
        match_all(problem, pairs, poses, gates, nullptr, active, &edges, memory);
    result.edge_sigma_mm = edges.sigma_mm;
    double cost = 0, weight = 0;
    for (const PairSum& s : sums) {
      cost += s.cost;
      weight += s.weight;
    }
    if (!(weight > 0)) break;
    result.sigma_mm = std::max(std::sqrt(cost / weight), 0.1 * problem.noise_mm);
    const NormalEquations equations = equations_of(problem, pairs, poses, sums, result.sigma_mm);
    result.step_mm = apply_step(problem, equations.solve(), poses);
    if (at_end && result.step_mm < 0.02 * problem.noise_mm) break;
    const double goal = std::max(least, 3 * result.sigma_mm);
    if (scale <= goal * 1.0001) at_end = true;
    scale = std::min(scale, std::max(goal, kShrink * scale));
  }
  return result;
}

}  // namespace gantry::internal
