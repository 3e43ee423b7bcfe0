#include "joint/attempt.h"

#include <algorithm>

#include "joint/align_fine.h"
#include "joint/words.h"

namespace gantry::internal {
namespace {

/// Beyond these a result is not believed. On simulated parts right results show violations below 0.001 and
/// wobbles mostly below 0.08 mm, wrong ones violations above 0.01 or wobbles above 1 mm.
constexpr double kWorstViolation = 0.01;
constexpr double kWorstWobble_mm = 0.12;
/// ... or this many standard deviations of the residuals, where sensor and model are worse than that.
constexpr double kWorstWobbleInSigmas = 1.5;
/// Fewer pixels say nothing of a fraction.
constexpr size_t kLeastTested = 100;

constexpr size_t kFineSamples = 5000;

Vector6d motion_of(const Eigen::VectorXd& motion, size_t scan) {
  return motion.segment<6>(static_cast<Eigen::Index>(6 * scan));
}

/// Which scans a motion sets against scan 0, and how.
std::string sliding_in_words(const JointProblem& problem, const Eigen::VectorXd& motion) {
  std::vector<size_t> moved;
  size_t most = 0;
  double largest = 0;
  std::vector<double> lengths;
  for (size_t i = 0; i < problem.size(); ++i) {
    const Vector6d m = motion_of(motion, i);
    lengths.push_back(m.tail<3>().norm() + problem.radius_mm * m.head<3>().norm());
    if (lengths.back() > largest) {
      largest = lengths.back();
      most = i;
    }
  }
  for (size_t i = 0; i < problem.size(); ++i)
    if (lengths[i] > 0.5 * largest) moved.push_back(i);
  return names_of(problem, moved) + (moved.size() > 1 ? " are free for " : " is free for ") +
         motion_in_words(motion_of(motion, most), problem.radius_mm);
}

bool violates(const ScanEvidence& scan) {
  return scan.agreement.tested - scan.agreement.background >= kLeastTested &&
         scan.violation > kWorstViolation;
}

void judge(const JointProblem& problem, Attempt& attempt) {
  attempt.wobble = {};
  std::vector<size_t> lost, violating;
  for (size_t i = 0; i < problem.size(); ++i) {
    if (!attempt.left_out[i].empty()) continue;
    if (!attempt.evidence.scans[i].connected) lost.push_back(i);
    if (violates(attempt.evidence.scans[i])) violating.push_back(i);
  }
  if (!lost.empty()) {
    attempt.objection = "no usable overlap connects these scans to the first one: " + names_of(problem, lost);
    return;
  }
  if (!violating.empty()) {
    attempt.objection = text("surface lies where another scan looked through, up to %.1f %% of a scan: ",
                             100 * attempt.evidence.worst_violation) +
                        names_of(problem, violating);
    return;
  }
  attempt.wobble = wobble(problem, attempt.evidence.pairs, attempt.poses);
  const double limit_mm = worst_wobble_mm(attempt.sigma_mm);
  attempt.objection.clear();
  if (!(attempt.wobble.worst_mm <= limit_mm))
    attempt.objection =
        text("the result is not unique: pushed by 2 mm it came to rest %.3g mm away (limit %.2g mm): ",
             attempt.wobble.worst_mm, limit_mm) +
        sliding_in_words(problem, attempt.wobble.weakest);
}

}  // namespace

std::string names_of(const JointProblem& problem, const std::vector<size_t>& which) {
  std::string names;
  for (const size_t i : which) names += (names.empty() ? "" : ", ") + problem.scans[i].name;
  return names;
}

bool Attempt::in_place() const {
  return std::all_of(evidence.scans.begin(), evidence.scans.end(),
                     [](const ScanEvidence& scan) { return scan.connected && !violates(scan); });
}

size_t Attempt::left_out_count() const {
  return static_cast<size_t>(
      std::count_if(left_out.begin(), left_out.end(), [](const std::string& why) { return !why.empty(); }));
}

std::vector<bool> Attempt::left_out_mask() const {
  std::vector<bool> mask;
  for (const std::string& why : left_out) mask.push_back(!why.empty());
  return mask;
}

double worst_wobble_mm(double sigma_mm) {
  return std::max(kWorstWobble_mm, kWorstWobbleInSigmas * sigma_mm);
}

size_t most_left_out(size_t scans) {
  return scans / 4;
}

Attempt attempt_at(const JointProblem& problem, std::string way, Poses poses) {
  Attempt attempt;
  attempt.way = std::move(way);
  attempt.poses = std::move(poses);
  attempt.sigma_mm = problem.noise_mm;
  attempt.evidence.scans.resize(problem.size());
  attempt.left_out.resize(problem.size());
  return attempt;
}

void refine_and_judge(const JointProblem& problem, double start_mm, Attempt& attempt) {
  const std::vector<bool> out = attempt.left_out_mask();
  const Poses before = attempt.poses;
  const Pairs pairs = pairs_without(
      out, pairs_with_overlap(problem, attempt.poses, std::max(1.5 * start_mm, 6 * problem.noise_mm)));
  attempt.sigma_mm =
      align_fine(problem, pairs, {start_mm, kFineSamples, 30, {}, &attempt.memory}, attempt.poses).sigma_mm;
  for (size_t i = 0; i < problem.size(); ++i)
    if (out[i]) attempt.poses[i] = before[i];
  attempt.evidence = gather_evidence(problem, attempt.poses, attempt.sigma_mm);
  attempt.evidence.leave_out(out);
  judge(problem, attempt);
}

Pairs pairs_without(const std::vector<bool>& left_out, Pairs pairs) {
  std::erase_if(pairs, [&](const auto& pair) { return left_out[pair.first] || left_out[pair.second]; });
  return pairs;
}

Objections suspicious_scans(const JointProblem& problem, const Attempt& attempt) {
  const size_t n = problem.size(), most = most_left_out(n);
  Objections found;
  Evidence rest = attempt.evidence;
  std::vector<bool> out = attempt.left_out_mask();
  while (found.size() <= most) {
    // Whoever violates most; the first scan, which cannot be left out, only when it is worse than all others.
    size_t worst = n, worst_pixels = 0;
    for (size_t k = 1; k <= n; ++k) {
      const size_t i = k % n;
      const Agreement& a = rest.scans[i].agreement;
      if (out[i] || !violates(rest.scans[i]) || a.in_front + a.contact <= worst_pixels) continue;
      worst = i;
      worst_pixels = a.in_front + a.contact;
    }
    if (worst == n) break;
    found.emplace_back(worst, text("lies where other scans looked through, by %.1f %% of it",
                                   100 * rest.scans[worst].violation));
    out[worst] = true;
    rest.leave_out(out);
  }
  for (size_t i = 0; i < n; ++i)
    if (!out[i] && !rest.scans[i].connected)
      found.emplace_back(i, "shares no usable surface with the first scan, nor with others that do");
  if (!found.empty()) return found;
  const double limit_mm = worst_wobble_mm(attempt.sigma_mm);
  for (size_t i = 0; i < attempt.wobble.scans_mm.size(); ++i)
    if (attempt.wobble.scans_mm[i] > limit_mm)
      found.emplace_back(i, text("is not held: pushed by 2 mm it came to rest %.2g mm away (limit %.2g mm), ",
                                 attempt.wobble.scans_mm[i], limit_mm) +
                                motion_in_words(motion_of(attempt.wobble.weakest, i), problem.radius_mm));
  return found;
}

bool leave_out(const JointProblem& problem, const Objections& objections, Attempt& attempt) {
  if (objections.empty() || attempt.left_out_count() + objections.size() > most_left_out(problem.size()))
    return false;
  Attempt rest = attempt;
  for (const auto& [scan, why] : objections) {
    if (scan == 0) return false;
    rest.left_out[scan] = why;
  }
  rest.evidence.leave_out(rest.left_out_mask());
  // They may have pulled at the others.
  const double scale_mm = 3 * std::max(1.4142 * problem.noise_mm, attempt.sigma_mm);
  rest.sigma_mm =
      align_fine(problem, rest.evidence.pairs, {scale_mm, kFineSamples, 30, {}, &rest.memory}, rest.poses)
          .sigma_mm;
  for (size_t i = 0; i < problem.size(); ++i)
    if (!rest.left_out[i].empty()) rest.poses[i] = attempt.poses[i];
  if (difference_mm(problem, attempt.poses, rest.poses) > problem.noise_mm) {
    rest.evidence = gather_evidence(problem, rest.poses, rest.sigma_mm);
    rest.evidence.leave_out(rest.left_out_mask());
  }
  judge(problem, rest);
  if (!rest.objection.empty() && !leave_out(problem, suspicious_scans(problem, rest), rest)) return false;
  attempt = std::move(rest);
  return true;
}

bool leave_out_suspicious(const JointProblem& problem, Attempt& attempt) {
  return leave_out(problem, suspicious_scans(problem, attempt), attempt);
}

}  // namespace gantry::internal
