#include "joint/solution.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "joint/align_fine.h"
#include "joint/chord_errors.h"
#include "joint/leave_out.h"
#include "joint/words.h"

namespace gantry::internal {
namespace {

/// A scan that moves the others by more, when it is taken out, contradicts them.
constexpr double kWorstLeaveOneOut_mm = 0.25;
constexpr double kWorstLeaveOneOutInSigmas = 6;
/// ... and by so many of the standard deviations that independent pixels would leave: they are not, by far.
constexpr double kSignificant = 12;
constexpr double kLeastMotion_mm = 0.02;
/// A pose that is less certain than this somewhere on the part is of no use for inspection.
constexpr double kUncertain_mm = 0.15;
constexpr double kUncertainInSigmas = 2.2;

/// The last round on all pixels, after many on some, moves hardly anything: mostly the second, else one of
/// the next few.
constexpr double kAtRestInSigmas = 0.2, kAtRest_mm = 0.005;
constexpr int kMostRounds = 5;

/// All other limits grow with the residuals, where sensor and model are worse than the noise; this far.
constexpr double kWorstResidualInSigmas = 10, kWorstResidualInPitches = 2;

constexpr size_t kPolishSamples = 40000;

/// What chi-square exceeds once in a million times (Wilson and Hilferty 1931).
double chi_square_limit(double degrees) {
  constexpr double kOneInAMillion = 4.753;  // of a normal variable
  if (degrees <= 0) return 0;
  const double spread = 2 / (9 * degrees);
  return degrees * std::pow(1 - spread + kOneInAMillion * std::sqrt(spread), 3);
}

/// How far the other scans would go if one were taken out, to first order. Motions that are loosely held
/// without it are no contradiction, however large.
std::vector<double> leave_one_out(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                                  const std::vector<PairSum>& sums, const EdgeEvidence& edges,
                                  double sigma_mm) {
  std::vector<double> moved(problem.size(), 0);
  // How much edges are broken is held: a scan's part in finding that out could not be taken back out.
  EdgeEvidence fixed_break = edges;
  for (Vector6d& mixed : fixed_break.by_break) mixed.setZero();
  const NormalEquations equations = equations_of(problem, pairs, poses, sums, fixed_break, sigma_mm);
  const Eigen::VectorXd unit = equations.hessian().diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXd scaled = unit.asDiagonal() * equations.hessian() * unit.asDiagonal();
  scaled.diagonal().array() += 1e-12;
  const LeaveOut leave_out(scaled);
  for (size_t left_out = 0; left_out < problem.size(); ++left_out) {
    std::vector<size_t> scans;
    NormalEquations its(problem.size());
    for (size_t k = 0; k < pairs.size(); ++k) {
      const auto& [a, b] = pairs[k];
      if (a != left_out && b != left_out) continue;
      its.add_pair(a, b, sums[2 * k], 1 / (sigma_mm * sigma_mm));
      its.add_pair(b, a, sums[2 * k + 1], 1 / (sigma_mm * sigma_mm));
      scans.push_back(a == left_out ? b : a);
    }
    if (scans.empty()) continue;
    scans.push_back(left_out);
    std::vector<Eigen::Index> rows;
    for (const size_t scan : scans)
      for (Eigen::Index k = 0; k < 6; ++k) rows.push_back(static_cast<Eigen::Index>(6 * scan) + k);
    const Eigen::VectorXd its_unit = unit(rows);
    const Eigen::MatrixXd part = its_unit.asDiagonal() * its.hessian()(rows, rows) * its_unit.asDiagonal();
    const Eigen::VectorXd down = -(equations.gradient() - its.gradient());
    const Eigen::VectorXd step = unit.asDiagonal() * leave_out.solve(scans, part, unit.asDiagonal() * down);
    // What the others' motions are seen against: the first of them.
    const size_t base = left_out > 0 ? 0 : *std::min_element(scans.begin(), scans.end() - 1);
    for (size_t i = 0; i < problem.size(); ++i) {
      // Scans that hang on this one alone are free without it, which is no contradiction.
      const bool held = std::any_of(pairs.begin(), pairs.end(), [&](const auto& p) {
        return (p.first == i || p.second == i) && p.first != left_out && p.second != left_out;
      });
      if (i == left_out || i == base || !held) continue;
      const Vector6d relative = step.segment<6>(static_cast<Eigen::Index>(6 * i)) -
                                step.segment<6>(static_cast<Eigen::Index>(6 * base));
      const double moves_mm = relative.tail<3>().norm() + problem.radius_mm * relative.head<3>().norm();
      if (!std::isfinite(moves_mm)) moved[left_out] = std::numeric_limits<double>::infinity();
      if (moves_mm <= moved[left_out] || moves_mm <= kLeastMotion_mm) continue;
      Eigen::VectorXd along = Eigen::VectorXd::Zero(step.size());  // of the motion, at the part's radius
      Vector6d length;
      length << Eigen::Vector3d::Constant(problem.radius_mm), Eigen::Vector3d::Ones();
      along.segment<6>(static_cast<Eigen::Index>(6 * i)) =
          length.cwiseProduct(length).cwiseProduct(relative) / length.cwiseProduct(relative).norm();
      along.segment<6>(static_cast<Eigen::Index>(6 * base)) =
          -along.segment<6>(static_cast<Eigen::Index>(6 * i));
      const double variance =
          along.dot(unit.asDiagonal() * leave_out.solve(scans, part, unit.asDiagonal() * along));
      if (moves_mm > kSignificant * std::sqrt(std::max(0.0, variance))) moved[left_out] = moves_mm;
    }
  }
  return moved;
}

double uncertain_mm(const Attempt& attempt) {
  return std::max(kUncertain_mm, kUncertainInSigmas * attempt.sigma_mm);
}

/// For each slot: of every pair, the second scan on the first, and the first on the second.
std::vector<Vector6d> chords_of(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                                const MatchGates& gates) {
  const Slots slots{pairs};
  std::vector<Vector6d> chords(slots.count());
  tbb::parallel_for(size_t{0}, chords.size(), [&](size_t slot) {
    const size_t target = slots.target(slot), source = slots.source(slot);
    chords[slot] =
        chord_errors(problem.scans[target], problem.scans[source], poses[target].inverse() * poses[source],
                     poses[target], problem.centre, gates);
  });
  return chords;
}

/// Turns an error's rotation and translation alike.
Matrix6d turn_of(const Pose& gauge) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = gauge.linear();
  turn.bottomRightCorner<3, 3>() = gauge.linear();
  return turn;
}

std::vector<Matrix6d> covariances(const PoseCovariance& covariance, const Pose& gauge, size_t scans) {
  const Matrix6d turn = turn_of(gauge);
  std::vector<Matrix6d> result(scans, Matrix6d::Zero());
  for (size_t i = 1; i < scans; ++i) result[i] = turn * covariance.of(i) * turn.transpose();
  return result;
}

}  // namespace

Solution solve_finely(const JointProblem& problem, const Attempt& attempt) {
  const size_t n = problem.size();
  const Pairs& pairs = attempt.evidence.pairs;
  Solution solution;
  solution.poses = attempt.poses;
  Poses& poses = solution.poses;
  std::vector<ActiveBlocks> active;
  MatchGates gates;
  gates.edges.break_mm =
      align_fine(problem, pairs, {3 * attempt.sigma_mm, kPolishSamples, 4}, poses, &active).edges.break_mm;
  gates.stride = 1;
  gates.scale_mm = std::max(3 * 1.4142 * problem.noise_mm, 3 * attempt.sigma_mm);
  gates.reach_mm = 3 * gates.scale_mm;
  gates.max_angle_rad = 0.35;
  gates.normal_variance = problem.normal_variance;
  std::vector<std::vector<BlockSum>> blocks;
  EdgeEvidence edges;
  solution.leave_one_out_mm.assign(n, 0);
  if (!pairs.empty()) {
    const auto step_by = [&](const std::vector<PairSum>& by) {
      const Eigen::VectorXd step = equations_of(problem, pairs, poses, by, edges, attempt.sigma_mm).solve();
      solution.last_step_mm = apply_step(problem, step, poses);
      gates.edges.break_mm = broken_after(problem, pairs, edges, step);
    };
    step_by(match_all(problem, pairs, poses, gates, nullptr, &active, &edges));
    Poses before;
    for (int round = 0; round == 0 || (round < kMostRounds && !at_rest(problem, solution)); ++round) {
      before = poses;
      solution.sums = match_all(problem, pairs, poses, gates, &blocks, &active, &edges);
      step_by(solution.sums);
    }
    solution.leave_one_out_mm = leave_one_out(problem, pairs, before, solution.sums, edges, attempt.sigma_mm);
  }
  solution.pairs = pairs;
  solution.edges = edges.model;
  solution.gauge = problem.scans[0].part_from_grid() * poses[0].inverse();
  solution.from_tags = problem.tag_prior.chi_square(errors_of_tags(problem, poses));
  std::vector<Vector6d> chords = chords_of(problem, pairs, poses, gates);
  const PoseCovariance covariance = pose_covariance(problem, pairs, solution.sums, blocks, edges, chords);
  solution.covariance = covariances(covariance, solution.gauge, n);
  solution.joint_covariance = carried_covariance(covariance.joint(), turn_of(solution.gauge));
  if (attempt.left_out_count() == 0) return solution;

  // What is left out has been drawn to its tag, where it does not disturb the others: back to where it was.
  const Pairs& others = attempt.evidence.pairs_of_left_out;
  for (size_t i = 0; i < n; ++i)
    if (!attempt.left_out[i].empty()) poses[i] = poses[0] * attempt.poses[0].inverse() * attempt.poses[i];
  std::vector<std::vector<BlockSum>> its_blocks;
  EdgeEvidence its_edges;
  const std::vector<PairSum> its_sums =
      match_all(problem, others, poses, gates, &its_blocks, nullptr, &its_edges);
  const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
  append(solution.pairs, others);
  append(solution.sums, its_sums);
  append(blocks, its_blocks);
  append(chords, chords_of(problem, others, poses, gates));
  append(edges.hessians, its_edges.hessians);
  append(edges.by_break, its_edges.by_break);
  edges.break_hessian += its_edges.break_hessian;
  const std::vector<Matrix6d> with_all = covariances(
      pose_covariance(problem, solution.pairs, solution.sums, blocks, edges, chords), solution.gauge, n);
  const TagPrior::ChiSquare from_tags = problem.tag_prior.chi_square(errors_of_tags(problem, poses));
  for (size_t i = 0; i < n; ++i) {
    if (attempt.left_out[i].empty()) continue;
    solution.covariance[i] = with_all[i];
    solution.from_tags.own[i] = from_tags.own[i];
  }
  return solution;
}

std::string observability_of(const JointProblem& problem, const Attempt& attempt, const Solution& solution,
                             size_t scan) {
  if (scan == 0) return "the reference";
  return observability_in_words(solution.covariance[scan], problem.radius_mm, uncertain_mm(attempt));
}

Objections objections_to(const JointProblem& problem, const Attempt& attempt, const Solution& solution) {
  const double worst_leave_one_out_mm =
      std::max(kWorstLeaveOneOut_mm, kWorstLeaveOneOutInSigmas * attempt.sigma_mm);
  const double worst_prior_chi_square = chi_square_limit(6);
  Vector6d unit;
  unit << Eigen::Vector3d::Constant(problem.radius_mm), Eigen::Vector3d::Ones();
  // A scan that pulls at the others makes them look bad, too: the worst one is enough for once.
  const auto pulls = std::max_element(solution.leave_one_out_mm.begin(), solution.leave_one_out_mm.end());
  // All tests are written so that NaN fails them.
  if (!(*pulls <= worst_leave_one_out_mm))
    return {{static_cast<size_t>(pulls - solution.leave_one_out_mm.begin()),
             text("contradicts the others: without it they would move by %.2f mm (limit %.2f mm)", *pulls,
                  worst_leave_one_out_mm)}};
  Objections far, uncertain;
  for (size_t i = 0; i < problem.size(); ++i) {
    if (!attempt.left_out[i].empty()) continue;
    if (!(solution.from_tags.own[i] <= worst_prior_chi_square)) {
      far.emplace_back(i, text("ended further from its tagged pose than the tag's covariance allows "
                               "(chi-square %.0f, limit %.0f)",
                               solution.from_tags.own[i], worst_prior_chi_square));
      continue;
    }
    const Matrix6d scaled = unit.asDiagonal() * solution.covariance[i] * unit.asDiagonal();
    if (!scaled.allFinite() || !(Eigen::SelfAdjointEigenSolver<Matrix6d>(scaled).eigenvalues()(5) <=
                                 std::pow(uncertain_mm(attempt), 2)))
      uncertain.emplace_back(i,
                             "is not held well enough: " + observability_of(problem, attempt, solution, i));
  }
  // One wrong tag drags the others off theirs: the worst comes first.
  std::stable_sort(far.begin(), far.end(), [&](const auto& a, const auto& b) {
    return solution.from_tags.own[a.first] > solution.from_tags.own[b.first];
  });
  far.insert(far.end(), uncertain.begin(), uncertain.end());
  return far;
}

bool at_rest(const JointProblem& problem, const Solution& solution) {
  return solution.last_step_mm <= std::max(kAtRestInSigmas * problem.noise_mm, kAtRest_mm);
}

std::string objection_to_all(const JointProblem& problem, const Attempt& attempt, const Solution& solution) {
  const double most_mm =
      std::max(kWorstResidualInSigmas * problem.noise_mm, kWorstResidualInPitches * problem.spacing_mm);
  if (!(attempt.sigma_mm <= most_mm))
    return text(
        "the scans do not fit each other: matched surfaces lie %.2g mm apart (one sigma, limit %.2g mm) "
        "at a noise of %.2g mm; is a scan's scale wrong, or was the part bent between them?",
        attempt.sigma_mm, most_mm, problem.noise_mm);
  if (!at_rest(problem, solution))
    return text("it has not come to rest: the last round moved a scan by %.3g mm", solution.last_step_mm);
  const double worst = chi_square_limit(static_cast<double>(problem.tag_prior.parameters()));
  if (solution.from_tags.shared <= worst) return "";
  return text(
      "the scans together ended further from their tagged poses than the stated calibration allows "
      "(chi-square %.0f, limit %.0f)",
      solution.from_tags.shared, worst);
}

}  // namespace gantry::internal
