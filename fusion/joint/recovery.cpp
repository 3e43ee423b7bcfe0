#include "joint/recovery.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "joint/placement.h"

namespace gantry::internal {
namespace {

constexpr double kAgrees = 0.03;  ///< Violation below which a coarsely placed scan may belong to a set.
/// ... and below which two finely placed scans agree; and fewer violating samples than this are chance.
constexpr double kAgreesFinely = 0.005;
constexpr size_t kChance = 8;
/// More scans than this are set together where they agree.
constexpr size_t kMany = 16;
constexpr double kLeastMatched = 0.04;  ///< Of the samples, for two scans to say anything of each other.
constexpr double kWidest_rad = 0.52;    ///< Starts are turned by as much as this.

/// The largest set that hangs together by pairs that agree and in which no pair disagrees, grown greedily
/// from the best pair.
std::vector<size_t> consistent_core(const JointProblem& problem, const Poses& poses,
                                    const std::vector<bool>& suspects) {
  const size_t n = problem.size();
  const double tolerance_mm = std::max(6 * problem.noise_mm, problem.spacing_mm);
  std::vector<Fit> fits(n * n);
  tbb::parallel_for(size_t{0}, n * n, [&](size_t k) {
    const size_t a = k / n, b = k % n;
    if (a < b) fits[k] = fit_of_pair(problem, a, b, poses[a], poses[b], tolerance_mm);
  });
  const auto fit = [&](size_t a, size_t b) -> const Fit& {
    return fits[std::min(a, b) * n + std::max(a, b)];
  };
  const auto speaks = [&](const Fit& f) {
    return static_cast<double>(f.matched) > 2 * kLeastMatched * static_cast<double>(kFitSamples);
  };
  std::vector<size_t> best;
  size_t best_matched = 0;
  for (size_t seed = 0; seed < n; ++seed) {
    if (suspects[seed]) continue;
    std::vector<size_t> core = {seed};
    size_t matched = 0;
    while (true) {
      size_t next = n, next_matched = 0;
      for (size_t i = 0; i < n; ++i) {
        if (suspects[i] || std::find(core.begin(), core.end(), i) != core.end()) continue;
        size_t here = 0;
        bool clash = false;
        for (const size_t c : core) {
          const Fit& f = fit(c, i);
          clash = clash || (f.violation() > kAgreesFinely && f.violated > kChance);
          if (speaks(f)) here += f.matched;
        }
        if (!clash && here > next_matched) {
          next = i;
          next_matched = here;
        }
      }
      if (next == n) break;
      core.push_back(next);
      matched += next_matched;
    }
    if (core.size() > best.size() || (core.size() == best.size() && matched > best_matched)) {
      best = core;
      best_matched = matched;
    }
  }
  return best;
}

size_t index_of_best(const std::vector<Placement>& found) {
  size_t best = 0;
  for (size_t k = 1; k < found.size(); ++k)
    if (found[k].fit.score() > found[best].fit.score()) best = k;
  return best;
}

}  // namespace

Poses recover(const JointProblem& problem, const Poses& poses, const std::vector<bool>& suspects,
              bool global) {
  return place_again(problem, poses, consistent_core(problem, poses, suspects), global);
}

Poses place_again(const JointProblem& problem, const Poses& poses, std::vector<size_t> scans, bool global) {
  Core core{std::move(scans), poses};
  std::vector<size_t> left;
  for (size_t i = 0; i < problem.size(); ++i)
    if (!core.holds(i)) left.push_back(i);
  // Each round sets the scan that fits best, and, where there are many, all that agree; a larger core gives
  // the others more to hold on to.
  while (!left.empty()) {
    std::vector<Placement> found(left.size());
    tbb::parallel_for(size_t{0}, left.size(), [&](size_t k) {
      found[k] =
          placements(problem, core, left[k], starts_near_tag(problem, core, left[k], kWidest_rad), 1).front();
    });
    size_t best = index_of_best(found);
    if (found[best].fit.violation() > kAgrees && global) {
      tbb::parallel_for(size_t{0}, left.size(), [&](size_t k) {
        const std::vector<Start> starts = starts_from_features(problem, core, left[k]);
        if (starts.empty()) return;
        const Placement proposed = placements(problem, core, left[k], starts, 1).front();
        if (proposed.fit.score() > found[k].fit.score()) found[k] = proposed;
      });
      best = index_of_best(found);
    }
    std::vector<size_t> still_left;
    for (size_t k = 0; k < left.size(); ++k) {
      const bool agrees = found[k].fit.violation() < kAgreesFinely && found[k].fit.matched > kFitSamples;
      if (k != best && !(problem.size() > kMany && agrees)) {
        still_left.push_back(left[k]);
        continue;
      }
      core.poses[left[k]] = found[k].pose;
      core.scans.push_back(left[k]);
    }
    left = std::move(still_left);
  }
  return core.poses;
}

}  // namespace gantry::internal
