#include "joint/problem.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace gantry::internal {
namespace {

constexpr int kBandRows = 128;
/// Of the information that tilted normals pretend to hold; a little is left, so that the Hessian stays
/// positive in directions that nothing holds.
constexpr double kTiltsTakenOut = 0.7;
/// Pairs that agree in less than this fraction of what was tested share nothing worth matching.
constexpr double kLeastOverlap = 0.002;

size_t find_root(std::vector<size_t>& parent, size_t i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

}  // namespace

Pairs pairs_with_overlap(const JointProblem& problem, const Poses& poses, double tolerance_mm) {
  struct Candidate {
    size_t a, b, matched;
  };
  const size_t n = problem.size();
  std::vector<Candidate> candidates;
  for (size_t a = 0; a < n; ++a)
    for (size_t b = a + 1; b < n; ++b) candidates.push_back({a, b, 0});
  tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t k) {
    Candidate& c = candidates[k];
    for (const auto& [target, source] : {std::pair{c.a, c.b}, {c.b, c.a}}) {
      const RangeSurface& s = problem.scans[source];
      const int stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(s.usable) / 3000)));
      const Agreement agreement =
          compare(problem.scans[target], s, poses[target].inverse() * poses[source], tolerance_mm, stride);
      const double all = static_cast<double>(s.usable) / (stride * stride);
      if (static_cast<double>(agreement.matched) > kLeastOverlap * all) c.matched += agreement.matched;
    }
  });
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.matched > b.matched; });
  std::vector<size_t> partners(n, 0), parent(n);
  std::iota(parent.begin(), parent.end(), size_t{0});
  Pairs pairs;
  for (const Candidate& c : candidates) {
    if (c.matched == 0) break;
    const size_t root_a = find_root(parent, c.a), root_b = find_root(parent, c.b);
    if (root_a == root_b && partners[c.a] >= problem.max_partners && partners[c.b] >= problem.max_partners)
      continue;
    parent[root_a] = root_b;
    ++partners[c.a];
    ++partners[c.b];
    pairs.emplace_back(c.a, c.b);
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

std::vector<PairSum> match_all(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                               const MatchGates& gates, std::vector<std::vector<BlockSum>>* blocks,
                               std::vector<ActiveBlocks>* active) {
  struct Task {
    size_t slot, target, source;
    int first, last;
  };
  std::vector<Task> tasks;
  const int band = std::max(kBandRows, 32 * gates.stride);
  for (size_t k = 0; k < pairs.size(); ++k) {
    const auto& [a, b] = pairs[k];
    for (int way = 0; way < 2; ++way) {
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
      const RangeSurface& s = problem.scans[task.source];
      (*active)[task.slot].active.assign(
          static_cast<size_t>(ActiveBlocks::across(s.width)) * ActiveBlocks::across(s.height), 0);
    }
  }
  std::vector<PairSum> partial(tasks.size());
  std::vector<std::vector<BlockSum>> gradients(blocks ? tasks.size() : 0);
  tbb::parallel_for(size_t{0}, tasks.size(), [&](size_t t) {
    const Task& task = tasks[t];
    partial[t] =
        match_by_projection(problem.scans[task.target], problem.scans[task.source],
                            poses[task.target].inverse() * poses[task.source], poses[task.target],
                            problem.centre, gates, task.first, task.last, blocks ? &gradients[t] : nullptr,
                            use ? &(*active)[task.slot] : nullptr, fill ? &(*active)[task.slot] : nullptr);
  });
  std::vector<PairSum> sums(2 * pairs.size());
  if (blocks) blocks->assign(sums.size(), {});
  for (size_t t = 0; t < tasks.size(); ++t) {
    sums[tasks[t].slot] += partial[t];
    if (blocks) {
      auto& into = (*blocks)[tasks[t].slot];
      into.insert(into.end(), gradients[t].begin(), gradients[t].end());
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

FineResult align_fine(const JointProblem& problem, const Pairs& pairs, double start_mm, size_t samples,
                      int max_rounds, Poses& poses, std::vector<ActiveBlocks>* active) {
  constexpr double kShrink = 0.5;
  size_t usable = 0;
  for (const RangeSurface& s : problem.scans) usable += s.usable;
  MatchGates gates;
  gates.stride =
      std::max(1, static_cast<int>(std::lround(std::sqrt(static_cast<double>(usable) /
                                                         static_cast<double>(problem.size() * samples)))));
  gates.normal_variance = kTiltsTakenOut * problem.normal_variance;
  FineResult result;
  double scale = start_mm;
  const double least = 3 * 1.4142 * problem.noise_mm;
  result.sigma_mm = problem.noise_mm;
  bool at_end = false;
  for (result.rounds = 0; result.rounds < max_rounds; ++result.rounds) {
    gates.scale_mm = scale;
    gates.reach_mm = 3 * scale;
    gates.max_angle_rad = at_end ? 0.35 : 0.5236;
    const std::vector<PairSum> sums = match_all(problem, pairs, poses, gates, nullptr, active);
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
