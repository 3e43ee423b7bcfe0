#include "joint/arrangements.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "joint/align_fine.h"
#include "joint/placement.h"

namespace gantry::internal {
namespace {

constexpr size_t kWidth = 6;         ///< Arrangements that are kept.
constexpr size_t kAlternatives = 3;  ///< Places of each scan that are looked at ...
constexpr size_t kOfPair = 4;        ///< ... and of one scan beside another.
constexpr double kErrorOfPair_mm = 8;
constexpr double kLeastShared = 0.02;  ///< Of the samples, to be adjusted.
constexpr size_t kSamples = 1500;
constexpr int kRounds = 12;
constexpr double kLeastMatched = 0.08;  ///< Of the samples, for two scans to say anything of each other.
/// Errors of two tags are unlikely to differ by more, in sigmas of one.
constexpr double kWidestInSigmas = 3;

/// An arrangement of some scans so far.
struct Partial {
  Core core;
  double score = 0;
};

bool apart(const JointProblem& problem, const Pose& a, const Pose& b) {
  const Vector6d twist = log_about(problem.centre, a * b.inverse());
  return twist.tail<3>().norm() + problem.radius_mm * twist.head<3>().norm() > 2 * problem.coarse_mm;
}

bool same(const JointProblem& problem, const Partial& a, const Partial& b) {
  for (const size_t i : a.core.scans)
    if (!b.core.holds(i)) return false;
  const size_t first = a.core.scans.front();
  const Pose common = a.core.poses[first] * b.core.poses[first].inverse();
  return std::none_of(a.core.scans.begin(), a.core.scans.end(),
                      [&](size_t i) { return apart(problem, common * b.core.poses[i], a.core.poses[i]); });
}

/// The `most` best that differ, best first.
std::vector<Partial> best_distinct(const JointProblem& problem, std::vector<Partial> all, size_t most) {
  std::stable_sort(all.begin(), all.end(),
                   [](const Partial& a, const Partial& b) { return a.score > b.score; });
  std::vector<Partial> kept;
  for (Partial& next : all) {
    if (kept.size() == most) break;
    if (std::none_of(kept.begin(), kept.end(),
                     [&](const Partial& other) { return same(problem, next, other); }))
      kept.push_back(std::move(next));
  }
  return kept;
}

double widest_turn(const JointProblem& problem) {
  double sigma = 0;
  for (const PosePrior& prior : problem.priors)
    sigma = std::max(sigma, std::sqrt(prior.information.inverse().diagonal().head<3>().maxCoeff()));
  return std::min(0.8, kWidestInSigmas * sigma);
}

/// Adjusts the core and judges it anew, finely.
void refine(const JointProblem& problem, Partial& arrangement) {
  Core& core = arrangement.core;
  Pairs pairs;
  for (size_t k = 0; k < core.scans.size(); ++k)
    for (size_t l = k + 1; l < core.scans.size(); ++l) {
      const auto [a, b] = std::minmax(core.scans[k], core.scans[l]);
      if (fit_of_pair(problem, a, b, core.poses[a], core.poses[b], problem.coarse_mm).matched >
          kLeastShared * kFitSamples)
        pairs.emplace_back(a, b);
    }
  std::sort(pairs.begin(), pairs.end());
  if (!pairs.empty()) align_fine(problem, pairs, {problem.fine_start_mm(), kSamples, kRounds}, core.poses);
  const double tolerance_mm = std::max(6 * problem.noise_mm, problem.spacing_mm);
  Fit fit;
  Core before{{}, core.poses};
  for (const size_t i : core.scans) {
    for (const size_t c : before.scans)
      fit += fit_of_pair(problem, c, i, core.poses[c], core.poses[i], tolerance_mm);
    if (!before.scans.empty()) fit.from_tag += from_tag(problem, before, i, core.poses[i]);
    before.scans.push_back(i);
  }
  arrangement.score = fit.score();
}

/// Where each scan may lie beside each other one, in the frame of the other one's tag.
class PairPlacements {
 public:
  PairPlacements(const JointProblem& problem) : problem_(problem), n_(problem.size()), found_(n_ * n_) {
    Poses tagged;
    for (const PosePrior& prior : problem.priors) tagged.push_back(prior.part_from_grid);
    const double widest = widest_turn(problem);
    tbb::parallel_for(size_t{0}, n_ * n_, [&](size_t k) {
      const size_t a = k / n_, b = k % n_;
      if (a >= b) return;
      const Core alone{{a}, tagged};
      for (const Placement& p :
           placements(problem, alone, b, starts_near_tag(problem, alone, b, widest), kOfPair))
        if (p.fit.matched > kLeastMatched * kFitSamples) {
          found_[k].push_back(tagged[a].inverse() * p.pose);
          found_[b * n_ + a].push_back(found_[k].back().inverse());
        }
    });
  }

  /// Of a scan beside any of the core, those that fit the core best.
  std::vector<Start> beside(const Core& core, size_t scan) const {
    std::vector<Placement> found;
    for (const size_t c : core.scans)
      for (const Pose& relative : found_[c * n_ + scan]) {
        Placement p;
        p.pose = core.poses[c] * relative;
        for (const size_t other : core.scans)
          p.fit += fit_of_pair(problem_, other, scan, core.poses[other], p.pose, problem_.coarse_mm);
        found.push_back(p);
      }
    std::vector<Start> starts;
    for (const Placement& p : best_distinct(problem_, found, kOfPair))
      starts.push_back({p.pose, kErrorOfPair_mm});
    return starts;
  }

 private:
  const JointProblem& problem_;
  size_t n_;
  std::vector<std::vector<Pose>> found_;  // [of a][b], part_from_grid of a's tag
};

/// Places each scan of the best arrangement anew, now that all the others are there to hold on to: some could
/// only be guessed from a single neighbour.
std::vector<Partial> each_once_more(const JointProblem& problem, std::vector<Partial> beam) {
  const double widest = widest_turn(problem);
  const Partial best = beam.front();
  std::vector<std::vector<Placement>> found(best.core.scans.size());
  tbb::parallel_for(size_t{0}, found.size(), [&](size_t k) {
    Core others = best.core;
    others.scans.erase(others.scans.begin() + static_cast<std::ptrdiff_t>(k));
    if (others.scans.empty()) return;
    found[k] = placements(problem, others, best.core.scans[k],
                          starts_near_tag(problem, others, best.core.scans[k], widest), kAlternatives);
  });
  const size_t known = beam.size();
  for (size_t k = 0; k < found.size(); ++k)
    for (const Placement& place : found[k]) {
      beam.push_back(best);
      beam.back().core.poses[best.core.scans[k]] = place.pose;
    }
  tbb::parallel_for(known, beam.size(), [&](size_t k) { refine(problem, beam[k]); });
  return best_distinct(problem, std::move(beam), kWidth);
}

}  // namespace

std::vector<Arrangement> search_arrangements(const JointProblem& problem, const Poses& poses, size_t most) {
  const size_t n = problem.size();
  const PairPlacements pairs(problem);
  std::vector<Partial> beam;
  for (size_t i = 0; i < n; ++i) beam.push_back({{{i}, poses}, 0});
  for (size_t level = 1; level < n; ++level) {
    struct Task {
      size_t arrangement, scan;
      std::vector<Placement> found;
    };
    std::vector<Task> tasks;
    for (size_t a = 0; a < beam.size(); ++a)
      for (size_t i = 0; i < n; ++i)
        if (!beam[a].core.holds(i)) tasks.push_back({a, i, {}});
    tbb::parallel_for(size_t{0}, tasks.size(), [&](size_t t) {
      Task& task = tasks[t];
      const Core& core = beam[task.arrangement].core;
      task.found = placements(problem, core, task.scan, pairs.beside(core, task.scan), kAlternatives);
    });
    std::vector<Partial> grown;
    for (const Task& task : tasks)
      for (const Placement& place : task.found) {
        Partial next = beam[task.arrangement];
        next.core.scans.push_back(task.scan);
        next.core.poses[task.scan] = place.pose;
        next.score += place.fit.score();
        grown.push_back(std::move(next));
      }
    // Scans that share nothing with any other cannot be placed.
    if (grown.empty()) break;
    grown = best_distinct(problem, std::move(grown), 3 * kWidth);
    tbb::parallel_for(size_t{0}, grown.size(), [&](size_t k) { refine(problem, grown[k]); });
    beam = best_distinct(problem, std::move(grown), kWidth);
  }
  beam = each_once_more(problem, std::move(beam));
  std::vector<Arrangement> best;
  for (const Partial& arrangement : beam) {
    if (best.size() == most) break;
    best.push_back({arrangement.core.poses, arrangement.score});
  }
  return best;
}

std::vector<size_t> placed_otherwise(const JointProblem& problem, const Poses& a, const Poses& b) {
  const Pose common = a[0] * b[0].inverse();
  std::vector<size_t> which;
  for (size_t i = 1; i < a.size(); ++i)
    if (apart(problem, common * b[i], a[i])) which.push_back(i);
  return which;
}

}  // namespace gantry::internal
