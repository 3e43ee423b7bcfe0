#include "joint/problem.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace gantry::internal {
namespace {

constexpr int kBandRows = 128;
/// Pairs that agree in less than this fraction of what was tested share nothing worth matching.
constexpr double kLeastOverlap = 0.002;

/// An edge is not placed better than this by one of its pixels, in pitches, nor by all of them ...
constexpr double kEdgeSigma_px = 0.3, kEdgeOffset_px = 0.1;
/// ... until it is known how well, this is supposed ...
constexpr double kEdgeSigmaAtFirst_px = 1;
/// ... and so many of them in a row say the same, because they share a window (surface_edges.h).
constexpr double kEdgePixelsAlike = 9;
/// Broken and rounded edges differ by this, in pitches, with the side they are seen from.
constexpr double kEdgeScatter_px = 3;
/// Edges are broken by about this much unless these scans know better (ISO 13715 speaks of 0.1 to 0.5 mm).
constexpr double kUsualBreak_mm = 0.3;
/// Chamfers and fillets wider than this are surfaces of their own.
constexpr double kMostBroken_px = 8;
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

EdgeModel::Scatter scatter_of(const JointProblem& problem, const std::vector<RawSums>& sums,
                              EdgeSums RawSums::*kind) {
  double all = 0, weight = 0, offset = 0;
  double of_means = 0, of_pair_means = 0, of_mean = 0;  // squares
  for (const RawSums& s : sums) {
    PairSum pair;
    for (const PairSum& one : s.*kind) {
      pair += one;
      if (one.weight > 0) of_means += one.offset * one.offset / one.weight;
    }
    if (!(pair.weight > 0)) continue;
    of_pair_means += pair.offset * pair.offset / pair.weight;
    all += pair.cost;
    weight += pair.weight;
    offset += pair.offset;
  }
  const double least_mm = kEdgeOffset_px * problem.spacing_mm,
               least_sigma_mm = std::max(problem.noise_mm, kEdgeSigma_px * problem.spacing_mm);
  if (!(weight > 0)) return {least_sigma_mm, least_mm, least_mm};
  of_mean = offset * offset / weight;
  const auto root = [&](double squares) { return std::sqrt(std::max(0.0, squares) / weight); };
  return {std::max(root(all - of_means), least_sigma_mm), std::max(root(of_means - of_pair_means), least_mm),
          std::max(root(of_pair_means - of_mean), least_mm)};
}

/// Takes an offset that all these residuals have in common out of what they say, sums being in units of
/// 1/mm^2; the offset is known only to be about as large as `sigma_mm` (Schur complement).
void marginalise(PairSum& sum, double sigma_mm) {
  const double variance = sigma_mm * sigma_mm, left = 1 / (1 + variance * sum.weight);
  sum.hessian -= variance * left * sum.directions * sum.directions.transpose();
  sum.gradient -= variance * left * sum.offset * sum.directions;
  sum.directions *= left;
  sum.offset *= left;
  sum.weight *= left;
}

/// What edges say of a pair, in units of 1/mm^2, each matched pixel standing for `count` that err by chance.
PairSum weighed(const EdgeSums& sums, const EdgeModel::Scatter& scatter, double count) {
  const double each = count / std::pow(scatter.sigma_mm, 2);
  PairSum pair;
  for (PairSum one : sums) {
    if (!(one.weight > 0)) continue;
    one.take_out_tilts();
    one.hessian *= each;
    one.gradient *= each;
    one.directions *= each;
    one.offset *= each;
    one.weight *= each;
    marginalise(one, scatter.offset_mm);
    pair += one;
  }
  marginalise(pair, scatter.pair_offset_mm);
  return pair;
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
    size_t slot;
    int first, last;
  };
  const auto target_of = [&](size_t slot) {
    return slot % 2 == 0 ? pairs[slot / 2].first : pairs[slot / 2].second;
  };
  const auto source_of = [&](size_t slot) {
    return slot % 2 == 0 ? pairs[slot / 2].second : pairs[slot / 2].first;
  };
  const size_t slots = 2 * pairs.size();
  std::vector<RawSums> raw(slots);
  std::vector<unsigned char> remembered(slots, 0);
  std::vector<Task> tasks;
  for (size_t slot = 0; slot < slots; ++slot) {
    remembered[slot] =
        memory && memory->recall(problem, target_of(slot), source_of(slot), poses, gates, raw[slot]);
    if (remembered[slot]) continue;
    tasks.push_back({slot, kEdges, kEdges});
  }
  const int band = std::max(kBandRows, 32 * gates.stride);
  for (size_t slot = 0; slot < slots; ++slot) {
    if (remembered[slot]) continue;
    const int height = problem.scans[source_of(slot)].height;
    for (int row = 0; row < height; row += band) tasks.push_back({slot, row, std::min(height, row + band)});
  }
  const bool use = active && !active->empty(), fill = active && active->empty();
  if (fill) {
    active->resize(slots);
    for (size_t slot = 0; slot < slots; ++slot) {
      const RangeSurface& s = problem.scans[source_of(slot)];
      (*active)[slot].active.assign(
          static_cast<size_t>(ActiveBlocks::across(s.width)) * ActiveBlocks::across(s.height), 0);
    }
  }
  std::vector<PairSum> partial(tasks.size());
  std::vector<std::vector<BlockSum>> gradients(blocks ? tasks.size() : 0);
  tbb::parallel_for(size_t{0}, tasks.size(), [&](size_t t) {
    const Task& task = tasks[t];
    const size_t a = target_of(task.slot), b = source_of(task.slot);
    const RangeSurface &target = problem.scans[a], &source = problem.scans[b];
    const Pose target_from_source = poses[a].inverse() * poses[b];
    if (task.first == kEdges) {
      const EdgeGates edge = edge_gates(problem, source, gates);
      raw[task.slot].edges =
          match_edges(target, problem.edges[a], source, target_from_source, poses[a], problem.centre, edge);
      raw[task.slot].faces =
          match_edges_to_faces(target, source, target_from_source, poses[a], problem.centre, edge);
      return;
    }
    partial[t] =
        match_by_projection(target, source, target_from_source, poses[a], problem.centre, gates, task.first,
                            task.last, blocks ? &gradients[t] : nullptr,
                            use ? &(*active)[task.slot] : nullptr, fill ? &(*active)[task.slot] : nullptr);
  });
  for (size_t t = 0; t < tasks.size(); ++t)
    if (tasks[t].first != kEdges) raw[tasks[t].slot].surfaces += partial[t];
  for (size_t slot = 0; memory && slot < slots; ++slot)
    if (!remembered[slot]) memory->keep(target_of(slot), source_of(slot), poses, gates, raw[slot]);

  double cost = 0, weight = 0;
  for (const RawSums& r : raw) {
    cost += r.surfaces.cost;
    weight += r.surfaces.weight;
  }
  const double surface_variance =
      std::max(weight > 0 ? cost / weight : 0, std::pow(0.1 * problem.noise_mm, 2));
  EdgeModel model = gates.edges;
  if (!(model.at_edges.sigma_mm > 0)) model.at_edges = scatter_of(problem, raw, &RawSums::edges);
  if (!(model.at_faces.sigma_mm > 0)) model.at_faces = scatter_of(problem, raw, &RawSums::faces);
  // What becomes of each slot's gradients and Hessians; blocks follow.
  std::vector<PairSum> sums(slots);
  std::vector<Matrix6d> factors(slots);
  std::vector<double> softening(slots);
  const double share = surface_variance / (gates.stride * gates.stride);
  EdgeEvidence evidence;
  evidence.break_hessian = surface_variance / (kUsualBreak_mm * kUsualBreak_mm);
  evidence.break_gradient = evidence.break_hessian * model.break_mm;
  for (size_t slot = 0; slot < slots; ++slot) {
    sums[slot] = raw[slot].surfaces;
    softening[slot] = sums[slot].soften();
    factors[slot] = sums[slot].take_out_tilts();
    // What was skipped, of edges and of pixels, must not change how much they count against each other.
    const size_t step = edge_gates(problem, problem.scans[source_of(slot)], gates).step;
    const double count = static_cast<double>(step) / kEdgePixelsAlike;
    const PairSum edges = weighed(raw[slot].edges, model.at_edges, count),
                  faces = weighed(raw[slot].faces, model.at_faces, count);
    evidence.hessians.push_back(share * (edges.hessian + faces.hessian));
    evidence.by_break.push_back(share * faces.directions);
    evidence.break_hessian += share * faces.weight;
    evidence.break_gradient += share * faces.offset;
    sums[slot].hessian += evidence.hessians.back();
    sums[slot].gradient += share * (edges.gradient + faces.gradient);
  }
  if (edge_evidence) {
    evidence.model = model;
    *edge_evidence = std::move(evidence);
  }
  if (blocks) {
    blocks->assign(slots, {});
    for (size_t t = 0; t < tasks.size(); ++t) {
      const size_t slot = tasks[t].slot;
      const Eigen::Matrix<float, 6, 6> factor = factors[slot].cast<float>();
      for (BlockSum block : gradients[t]) {
        const Eigen::Matrix<float, 6, 6> hessian =
            static_cast<float>(softening[slot]) * factor * block.hessian;
        block.gradient = factor * block.gradient;
        block.hessian = 0.5f * (hessian + hessian.transpose());
        (*blocks)[slot].push_back(block);
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

Eigen::VectorXd by_break(const JointProblem& problem, const Pairs& pairs, const EdgeEvidence& edges) {
  Eigen::VectorXd mixed = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(6 * problem.size()));
  for (size_t slot = 0; slot < edges.by_break.size(); ++slot) {
    const auto& [a, b] = pairs[slot / 2];
    const size_t target = slot % 2 == 0 ? a : b, source = slot % 2 == 0 ? b : a;
    mixed.segment<6>(static_cast<Eigen::Index>(6 * source)) += edges.by_break[slot];
    mixed.segment<6>(static_cast<Eigen::Index>(6 * target)) -= edges.by_break[slot];
  }
  return mixed;
}

double broken_after(const JointProblem& problem, const Pairs& pairs, const EdgeEvidence& edges,
                    const Eigen::VectorXd& step) {
  const double more =
      -(edges.break_gradient + by_break(problem, pairs, edges).dot(step)) / edges.break_hessian;
  return std::clamp(edges.model.break_mm + more, 0.0, kMostBroken_px * problem.spacing_mm);
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
  gates.edges = options.edges;
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
    result.step_mm = apply_step(problem, step, poses);
    result.edges.break_mm = gates.edges.break_mm = broken_after(problem, pairs, edges, step);
    if (at_end && result.step_mm < 0.02 * problem.noise_mm) break;
    const double goal = std::max(least, 3 * result.sigma_mm);
    if (scale <= goal * 1.0001) at_end = true;
    scale = std::min(scale, std::max(goal, kShrink * scale));
  }
  return result;
}

}  // namespace gantry::internal
