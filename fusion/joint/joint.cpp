#include "gantry/fusion/joint.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gantry/foundation/error.h"
#include "joint/arrangements.h"
#include "joint/attempt.h"
#include "joint/recovery.h"
#include "joint/report.h"
#include "joint/setup.h"
#include "joint/solution.h"
#include "joint/words.h"

namespace gantry {
namespace {

using namespace internal;

/// Sets of at most so many scans are arranged anew in all ways that fit; so many are judged.
constexpr size_t kFew = 16, kArrangements = 4;
/// Chi-square of six degrees of freedom that is exceeded once in a thousand times.
constexpr double kUnlikely = 22.5;

void check(const JointOptions& options) {
  const auto finite_not_negative = [](double value, const char* name) {
    if (!std::isfinite(value) || value < 0)
      throw InputError(
          text("%s is %g: a length in mm is expected, or 0 to choose it from the data", name, value));
  };
  finite_not_negative(options.start_mm, "start_mm");
  finite_not_negative(options.noise_mm, "noise_mm");
}

void coarse_stages(const JointProblem& problem, double start_mm, double shrink, size_t samples,
                   const std::vector<bool>& left_out, Poses& poses) {
  CoarseOptions options;
  options.start_mm = start_mm;
  options.end_mm = problem.coarse_end_mm();
  options.shrink = shrink;
  options.samples = samples;
  align_coarse(problem.coarse,
               pairs_without(left_out, likely_pairs(problem.coarse, poses, start_mm, problem.max_partners)),
               problem.priors, problem.centre, options, poses);
  options.start_mm = problem.coarse_end_mm();
  options.end_mm = problem.medium_end_mm();
  options.start_angle_rad = options.end_angle_rad;
  align_coarse(problem.medium,
               pairs_without(left_out, likely_pairs(problem.medium, poses, problem.coarse_end_mm(),
                                                    problem.max_partners)),
               problem.priors, problem.centre, options, poses);
}

/// Scans that violate others by a good part of what the worst one does; none unless `doubt_violators`.
std::vector<bool> suspects(const Attempt& attempt, bool doubt_violators) {
  std::vector<bool> doubted;
  for (const ScanEvidence& scan : attempt.evidence.scans)
    doubted.push_back(doubt_violators && scan.violation > 0.3 * attempt.evidence.worst_violation);
  // Somebody must be kept to hold on to.
  if (std::count(doubted.begin(), doubted.end(), false) == 0) doubted.assign(doubted.size(), false);
  return doubted;
}

Attempt& least_violating(std::span<Attempt> attempts) {
  return *std::min_element(attempts.begin(), attempts.end(), [](const Attempt& a, const Attempt& b) {
    return a.evidence.worst_violation < b.evidence.worst_violation;
  });
}

/// The attempt that would be believed without the fewest scans.
Attempt& least_suspicious(const JointProblem& problem, std::vector<Attempt>& attempts) {
  std::vector<std::pair<size_t, double>> order;
  for (const Attempt& attempt : attempts)
    order.emplace_back(suspicious_scans(problem, attempt).size(), attempt.evidence.worst_violation);
  return attempts[static_cast<size_t>(std::min_element(order.begin(), order.end()) - order.begin())];
}

/// In a large set the few scans that are suspicious are placed again, and if that does not help they are left
/// out: the others need not be looked for again.
void mend(const JointProblem& problem, const JointOptions& options, std::vector<Attempt>& attempts) {
  const Attempt& before = attempts.back();
  const Objections suspicious = suspicious_scans(problem, before);
  if (suspicious.empty() || suspicious.size() > most_left_out(problem.size())) return;
  std::vector<bool> doubted(problem.size(), false);
  for (const auto& [scan, why] : suspicious) doubted[scan] = true;
  std::vector<size_t> core;
  for (size_t i = 0; i < problem.size(); ++i)
    if (!doubted[i]) core.push_back(i);
  Attempt mended = attempt_at(problem, before.way + ", suspicious scans placed again",
                              place_again(problem, before.poses, core, options.global_fallback));
  mended.memory = before.memory;
  refine_and_judge(problem, problem.fine_start_mm(), mended);
  if (!mended.objection.empty()) leave_out_suspicious(problem, mended);
  attempts.push_back(std::move(mended));
}

/// Whether a scan has ended where its tag makes it unlikely, though not impossible: on a part that is nearly
/// symmetric it may fit better elsewhere.
bool far_from_tags(const JointProblem& problem, const Attempt& attempt) {
  const std::vector<double> own = problem.tag_prior.chi_square(errors_of_tags(problem, attempt.poses)).own;
  return *std::max_element(own.begin(), own.end()) > kUnlikely;
}

/// Whether the tags make these poses a thousand times less likely than those.
bool decided_by_tags(const JointProblem& problem, const Poses& these, const Poses& those) {
  const auto chi_square = [&](const Poses& poses) {
    const TagPrior::ChiSquare all = problem.tag_prior.chi_square(errors_of_tags(problem, poses));
    return std::accumulate(all.own.begin(), all.own.end(), all.shared);
  };
  return chi_square(these) > chi_square(those) + 2 * std::log(1000.0);
}

/// Judges the best arrangements of all scans until one is believed, which is the last attempt then. True when
/// another one is believed as well, and no tag speaks against it: on a symmetric part it may fit worse, for
/// lying on fewer others, and be the right one. That is objected to, and no other attempt can heal it.
bool try_arrangements(const JointProblem& problem, const Poses& tagged, std::vector<Attempt>& attempts) {
  const std::vector<Arrangement> arrangements = search_arrangements(problem, tagged, kArrangements);
  size_t believed = arrangements.size();
  for (size_t k = 0; k < arrangements.size(); ++k) {
    Attempt next = attempt_at(problem, "several arrangements at a time", arrangements[k].poses);
    refine_and_judge(problem, problem.fine_start_mm(), next);
    if (believed < k) {
      const Poses& best = attempts.back().poses;
      if (!next.objection.empty() || decided_by_tags(problem, next.poses, best)) continue;
      const std::vector<size_t> otherwise = placed_otherwise(problem, best, next.poses);
      if (otherwise.empty()) continue;
      attempts.back().objection = "the result is ambiguous: these scans fit as well in another place: " +
                                  names_of(problem, otherwise);
      return true;
    }
    if (next.objection.empty()) believed = k;
    attempts.push_back(std::move(next));
  }
  return false;
}

/// The attempt whose outcome counts, believed or not, and of how many.
struct Outcome {
  Attempt best;
  size_t attempts;
};

/// From the cheapest way to the most thorough; the first outcome that is believed ends the search.
Outcome search(const JointProblem& problem, const JointOptions& options, double start_mm) {
  Poses tagged;
  for (const RangeSurface& s : problem.scans) tagged.push_back(s.part_from_grid());
  std::vector<Attempt> attempts;
  if (problem.size() == 1) return {attempt_at(problem, "one scan is its own result", tagged), 1};
  const auto attempt = [&](const char* way, double fine_start_mm, auto&& find_poses) {
    if (!attempts.empty() && attempts.back().objection.empty()) return;
    Attempt a = attempt_at(problem, way, tagged);
    find_poses(a.poses);
    refine_and_judge(problem, fine_start_mm, a);
    attempts.push_back(std::move(a));
    // Once: if that is not enough, it is not a few scans that are wrong.
    if (!attempts.back().objection.empty() && problem.many() && attempts.size() == 1)
      mend(problem, options, attempts);
  };
  const size_t samples =
      options.coarse_samples > 0 ? options.coarse_samples : problem.samples(kCoarseSamples);
  const std::vector<bool> none(problem.size(), false);
  // Good tags need no coarse stage: matches by projection find their way from a pixel or two.
  const bool near = start_mm <= 4 * problem.spacing_mm;
  if (near) attempt("from the tags", start_mm, [](Poses&) {});
  attempt("coarse to fine", problem.fine_start_mm(),
          [&](Poses& poses) { coarse_stages(problem, start_mm, 0.85, samples, none, poses); });
  attempt("coarse to fine, wider and slower", problem.fine_start_mm(), [&](Poses& poses) {
    coarse_stages(problem, std::max(25.0, 2 * start_mm), 0.93, samples, none, poses);
  });
  const size_t from_tags = attempts.size();
  if (problem.size() <= kFew &&
      (!attempts.back().objection.empty() || far_from_tags(problem, attempts.back())) &&
      try_arrangements(problem, tagged, attempts))
    return {std::move(attempts.back()), attempts.size()};
  const auto recovered = [&](bool doubt_violators) {
    return [&, doubt_violators](Poses& poses) {
      const Attempt& before = least_violating(attempts);
      poses = recover(problem, before.poses, suspects(before, doubt_violators), options.global_fallback);
    };
  };
  // Where nothing is in the wrong place but something is free to move, looking elsewhere does not help.
  if (!least_violating(attempts).in_place()) {
    attempt("scan by scan from many starts", problem.fine_start_mm(), recovered(false));
    attempt("scan by scan from many starts, violators first", problem.fine_start_mm(), recovered(true));
  }
  if (attempts.back().objection.empty()) return {std::move(attempts.back()), attempts.size()};
  // A scan of something else has pulled at its neighbours: from the tags on as if the worst were not there.
  Attempt rest = least_violating(std::span(attempts).first(from_tags));
  while (!rest.objection.empty() && !problem.many() &&
         rest.left_out_count() < most_left_out(problem.size())) {
    const Objections suspicious = suspicious_scans(problem, rest);
    if (suspicious.empty() || suspicious.front().first == 0) break;
    Attempt next = attempt_at(problem, "from the tags without what is left out", tagged);
    next.left_out = rest.left_out;
    next.left_out[suspicious.front().first] = suspicious.front().second;
    if (!near) coarse_stages(problem, start_mm, 0.85, samples, next.left_out_mask(), next.poses);
    for (size_t i = 0; i < problem.size(); ++i)
      if (!next.left_out[i].empty()) next.poses[i] = rest.poses[i];
    refine_and_judge(problem, problem.fine_start_mm(), next);
    rest = std::move(next);
  }
  if (rest.objection.empty()) return {std::move(rest), attempts.size() + 1};
  Attempt& best = least_suspicious(problem, attempts);
  leave_out_suspicious(problem, best);
  return {std::move(best), attempts.size()};
}

}  // namespace

Registration register_joint(std::span<const RangeSurface> scans, const JointOptions& options) {
  if (scans.empty()) throw InputError("registration: there is no scan to register");
  check(options);
  const JointProblem problem = make_problem(scans, options);
  const double start_mm = options.start_mm > 0 ? options.start_mm : std::min(15.0, 3 * tag_sigma_mm(problem));

  auto [best, attempts] = search(problem, options, start_mm);
  Solution solution = solve_finely(problem, best);
  while (best.objection.empty()) {
    best.objection = objection_to_all(problem, best, solution);
    const Objections objections = objections_to(problem, best, solution);
    if (objections.empty()) break;
    if (leave_out(problem, objections, best)) {
      solution = solve_finely(problem, best);
    } else {
      const auto& [scan, why] = objections.front();
      best.objection = scans[scan].name + " " + why;
      std::vector<size_t> others;
      for (const Objection& other : std::span(objections).subspan(1)) others.push_back(other.first);
      if (!others.empty()) best.objection += "; objections of their own: " + names_of(problem, others);
    }
  }
  if (scans.size() > 1 && best.wobble.scans_mm.empty())
    best.wobble = wobble(problem, best.evidence.pairs, best.poses);
  if (!best.objection.empty() && best.left_out_count() > 0) {
    std::vector<size_t> without;
    for (size_t i = 0; i < scans.size(); ++i)
      if (!best.left_out[i].empty()) without.push_back(i);
    best.objection += "; left out already: " + names_of(problem, without);
  }
  Registration result = report_of(problem, options, start_mm, best, solution);
  result.iterations = static_cast<int>(attempts);
  return result;
}

}  // namespace gantry
