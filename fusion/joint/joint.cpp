#include "gantry/fusion/joint.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gantry/foundation/error.h"
#include "joint/arrangements.h"
#include "joint/covariance.h"
#include "joint/judgement.h"
#include "joint/leave_out.h"
#include "joint/problem.h"
#include "joint/recovery.h"
#include "joint/words.h"

namespace gantry {
namespace {

using namespace internal;

/// Beyond these a result is not believed. On simulated parts right results show violations below 0.001 and
/// wobbles mostly below 0.08 mm, wrong ones violations above 0.01 or wobbles above 1 mm.
constexpr double kWorstViolation = 0.01;
constexpr double kWorstWobble_mm = 0.12;
/// ... or this many standard deviations of the residuals, where sensor and model are worse than that.
constexpr double kWorstWobbleInSigmas = 1.5;
/// A scan that moves the others by more, when it is taken out, contradicts them.
constexpr double kWorstLeaveOneOut_mm = 0.25;
constexpr double kWorstLeaveOneOutInSigmas = 6;
/// A pose that is less certain than this somewhere on the part is of no use for inspection.
constexpr double kUncertain_mm = 0.15;
constexpr double kUncertainInSigmas = 2.2;
/// Fewer pixels say nothing of a fraction.
constexpr size_t kLeastTested = 100;

/// Sets of at most so many scans are arranged anew in all ways that fit; so many are judged.
constexpr size_t kFew = 16, kArrangements = 4;
constexpr size_t kFineSamples = 5000, kPolishSamples = 40000;
constexpr int kCoarsestStep = 16;
constexpr size_t kCoarsePoints = 200;

/// What chi-square exceeds once in a million times (Wilson and Hilferty 1931).
double chi_square_limit(double degrees) {
  constexpr double kOneInAMillion = 4.753;  // of a normal variable
  if (degrees <= 0) return 0;
  const double spread = 2 / (9 * degrees);
  return degrees * std::pow(1 - spread + kOneInAMillion * std::sqrt(spread), 3);
}

template <typename T>
T median_of(std::vector<T> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// How much noise tilts a normal about each axis across it: variance of the slope of a plane fitted to a
/// window of n x n pixels without the inner nine (grid_normals.h).
double normal_variance_of(const RangeSurface& s) {
  const double n = 2 * s.normal_window_px + 1;
  const double spread = n * n * (n * n - 1) / 12 - 6;
  return std::pow(s.noise_mm / s.spacing_mm, 2) / spread;
}

void place_centre(JointProblem& problem) {
  std::vector<Eigen::Vector3d> places;
  for (size_t i = 0; i < problem.size(); ++i)
    for (const int k : problem.coarse_levels[i].filled)
      places.push_back(problem.scans[i].part_from_grid() * problem.coarse_levels[i].point(k).cast<double>());
  if (places.empty()) return;
  for (const Eigen::Vector3d& p : places) problem.centre += p / static_cast<double>(places.size());
  std::vector<double> distances;
  for (const Eigen::Vector3d& p : places) distances.push_back((p - problem.centre).norm());
  std::sort(distances.begin(), distances.end());
  problem.radius_mm = std::max(1e-3, distances[distances.size() * 9 / 10]);
}

/// The coarsest level is as coarse as leaves enough points to most scans.
void make_levels(JointProblem& problem) {
  const size_t n = problem.size();
  problem.coarse_levels.resize(n);
  problem.medium_levels.resize(n);
  int step = kCoarsestStep;
  for (; step >= 2; step /= 2) {
    tbb::parallel_for(size_t{0}, n,
                      [&](size_t i) { problem.coarse_levels[i] = make_level(problem.scans[i], step); });
    std::vector<size_t> points;
    for (const CoarseLevel& level : problem.coarse_levels) points.push_back(level.filled.size());
    if (step == 2 || median_of(points) >= kCoarsePoints) break;
  }
  tbb::parallel_for(size_t{0}, n,
                    [&](size_t i) { problem.medium_levels[i] = make_level(problem.scans[i], step / 2); });
  std::vector<double> coarse, medium;
  for (size_t i = 0; i < n; ++i) {
    coarse.push_back(problem.coarse_levels[i].spacing_mm);
    medium.push_back(problem.medium_levels[i].spacing_mm);
  }
  problem.coarse_mm = median_of(coarse);
  problem.medium_mm = median_of(medium);
}

JointProblem make_problem(std::span<const RangeSurface> scans, const JointOptions& options) {
  JointProblem problem;
  problem.scans = scans;
  const size_t n = scans.size();
  make_levels(problem);
  std::vector<double> noise, spacing, tilts;
  for (size_t i = 0; i < n; ++i) {
    problem.coarse.levels.push_back(&problem.coarse_levels[i]);
    problem.medium.levels.push_back(&problem.medium_levels[i]);
    problem.coarse.rays.push_back(&scans[i].rays);
    problem.medium.rays.push_back(&scans[i].rays);
    noise.push_back(scans[i].noise_mm);
    spacing.push_back(scans[i].spacing_mm);
    tilts.push_back(normal_variance_of(scans[i]));
  }
  place_centre(problem);
  for (const RangeSurface& s : scans) problem.edges.emplace_back(s);
  problem.noise_mm = options.noise_mm > 0 ? options.noise_mm : median_of(noise);
  problem.spacing_mm = median_of(spacing);
  problem.normal_variance = median_of(tilts) / 2;  // the mean of two normals
  if (options.max_partners > 0) problem.max_partners = options.max_partners;
  problem.tag_prior = TagPrior(scans, problem.centre);
  for (size_t i = 0; i < n; ++i)
    problem.priors.push_back({scans[i].part_from_grid(), problem.tag_prior.information_of(i)});
  return problem;
}

/// The largest displacement, at the part's radius, that the tags' covariance makes likely (one sigma).
double tag_sigma_mm(const JointProblem& problem) {
  double largest = 0;
  Vector6d unit;
  unit << Eigen::Vector3d::Constant(problem.radius_mm), Eigen::Vector3d::Ones();
  for (const PosePrior& prior : problem.priors) {
    const Matrix6d covariance = prior.information.inverse();
    const Matrix6d scaled = unit.asDiagonal() * covariance * unit.asDiagonal();
    largest = std::max(largest, std::sqrt(Eigen::SelfAdjointEigenSolver<Matrix6d>(scaled).eigenvalues()(5)));
  }
  return largest;
}

/// One try at the whole problem, and what speaks against its outcome.
struct Attempt {
  std::string way;
  Poses poses;
  Evidence evidence;
  double sigma_mm = 0;
  double wobble_mm = 0;
  Eigen::VectorXd weakest;
  std::string objection;  ///< Empty: believed.
};

std::string names_of(const JointProblem& problem, const std::vector<size_t>& which) {
  std::string names;
  for (const size_t i : which) names += (names.empty() ? "" : ", ") + problem.scans[i].name;
  return names;
}

/// Which scans a motion sets against scan 0, and how.
std::string sliding_in_words(const JointProblem& problem, const Eigen::VectorXd& motion) {
  std::vector<size_t> moved;
  size_t most = 0;
  double largest = 0;
  std::vector<double> lengths;
  for (size_t i = 0; i < problem.size(); ++i) {
    const Vector6d m = motion.segment<6>(static_cast<Eigen::Index>(6 * i));
    lengths.push_back(m.tail<3>().norm() + problem.radius_mm * m.head<3>().norm());
    if (lengths.back() > largest) {
      largest = lengths.back();
      most = i;
    }
  }
  for (size_t i = 0; i < problem.size(); ++i)
    if (lengths[i] > 0.5 * largest) moved.push_back(i);
  return names_of(problem, moved) + (moved.size() > 1 ? " are free for " : " is free for ") +
         motion_in_words(motion.segment<6>(static_cast<Eigen::Index>(6 * most)), problem.radius_mm);
}

std::string objection_to(const JointProblem& problem, const Attempt& attempt) {
  std::vector<size_t> lost, violating;
  for (size_t i = 0; i < problem.size(); ++i) {
    const ScanEvidence& scan = attempt.evidence.scans[i];
    if (!scan.connected) lost.push_back(i);
    if (scan.agreement.tested - scan.agreement.background >= kLeastTested && scan.violation > kWorstViolation)
      violating.push_back(i);
  }
  if (!lost.empty())
    return "no usable overlap connects these scans to the first one: " + names_of(problem, lost);
  if (!violating.empty())
    return text("surface lies where another scan looked through, up to %.1f %% of a scan: ",
                100 * attempt.evidence.worst_violation) +
           names_of(problem, violating);
  const double worst_wobble_mm = std::max(kWorstWobble_mm, kWorstWobbleInSigmas * attempt.sigma_mm);
  if (!(attempt.wobble_mm <= worst_wobble_mm))
    return text("the result is not unique: pushed by 2 mm it came to rest %.3g mm away (limit %.2g mm): ",
                attempt.wobble_mm, worst_wobble_mm) +
           sliding_in_words(problem, attempt.weakest);
  return "";
}

template <typename Attempts>
auto& least_violating(Attempts& attempts) {
  return *std::min_element(attempts.begin(), attempts.end(), [](const Attempt& a, const Attempt& b) {
    return a.evidence.worst_violation < b.evidence.worst_violation;
  });
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

void coarse_stages(const JointProblem& problem, double start_mm, double shrink, size_t samples,
                   Poses& poses) {
  CoarseOptions options;
  options.start_mm = start_mm;
  options.end_mm = problem.coarse_end_mm();
  options.shrink = shrink;
  options.samples = samples;
  align_coarse(problem.coarse, likely_pairs(problem.coarse, poses, start_mm, problem.max_partners),
               problem.priors, problem.centre, options, poses);
  options.start_mm = problem.coarse_end_mm();
  options.end_mm = problem.medium_end_mm();
  options.start_angle_rad = options.end_angle_rad;
  align_coarse(problem.medium,
               likely_pairs(problem.medium, poses, problem.coarse_end_mm(), problem.max_partners),
               problem.priors, problem.centre, options, poses);
}

/// From roughly right poses to a judged result.
void refine_and_judge(const JointProblem& problem, double start_mm, Attempt& attempt) {
  Pairs pairs = pairs_with_overlap(problem, attempt.poses, std::max(1.5 * start_mm, 6 * problem.noise_mm));
  attempt.sigma_mm = align_fine(problem, pairs, {start_mm, kFineSamples, 30}, attempt.poses).sigma_mm;
  attempt.evidence = gather_evidence(problem, attempt.poses, attempt.sigma_mm);
  attempt.wobble_mm = wobble_mm(problem, attempt.evidence.pairs, attempt.poses, &attempt.weakest);
  attempt.objection = objection_to(problem, attempt);
}

/// How far the other scans would go if one were taken out, to first order.
std::vector<double> leave_one_out(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                                  const std::vector<PairSum>& sums, double sigma_mm) {
  std::vector<double> moved(problem.size(), 0);
  const NormalEquations equations = equations_of(problem, pairs, poses, sums, sigma_mm);
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
    const size_t base = left_out == 0 ? 1 : 0;
    for (size_t i = 0; i < problem.size(); ++i) {
      // Scans that hang on this one alone are free without it, which is no contradiction.
      const bool held = std::any_of(pairs.begin(), pairs.end(), [&](const auto& p) {
        return (p.first == i || p.second == i) && p.first != left_out && p.second != left_out;
      });
      if (i == left_out || i == base || !held) continue;
      const Vector6d relative = step.segment<6>(static_cast<Eigen::Index>(6 * i)) -
                                step.segment<6>(static_cast<Eigen::Index>(6 * base));
      moved[left_out] = std::max(moved[left_out],
                                 relative.tail<3>().norm() + problem.radius_mm * relative.head<3>().norm());
    }
  }
  return moved;
}

std::vector<ParameterChoice> choices_of(const JointProblem& problem, const JointOptions& options,
                                        double start_mm, double sigma_mm, double edge_sigma_mm) {
  return {{"noise_mm", problem.noise_mm,
           options.noise_mm > 0 ? "given" : "median over the scans, from second differences along rows"},
          {"spacing_mm", problem.spacing_mm, "median pixel pitch at the part"},
          {"normal_window_px", 2.0 * problem.scans[0].normal_window_px + 1,
           "smallest window in which noise tilts normals by less than 1.7 degrees"},
          {"start_mm", start_mm,
           options.start_mm > 0 ? "given"
                                : "three sigma of the tagged poses at the part's radius, at most 15 mm"},
          {"coarse_samples", static_cast<double>(options.coarse_samples > 0 ? options.coarse_samples : 200),
           options.coarse_samples > 0 ? "given" : "150 to 2000 serve alike"},
          {"max_partners", static_cast<double>(problem.max_partners),
           options.max_partners > 0 ? "given" : "the scans with most surface in common; more add nothing"},
          {"shared_parameters", static_cast<double>(problem.tag_prior.parameters()),
           problem.tag_prior.parameters() > 0
               ? "calibrated parameters of the cell, whose errors all tagged poses share"
               : "the tags do not say what their errors share: taken as independent"},
          {"edge_sigma_mm", edge_sigma_mm,
           "of the edges at which surfaces end; the less they scatter, the more they count"},
          {"residual_sigma_mm", sigma_mm,
           "of the matches at the end; three times this is the final robust scale"},
          {"part_radius_mm", problem.radius_mm, "nine tenths of the surface lie nearer to the centre"}};
}

void check(const JointOptions& options) {
  const auto finite_not_negative = [](double value, const char* name) {
    if (!std::isfinite(value) || value < 0)
      throw InputError(
          text("%s is %g: a length in mm is expected, or 0 to choose it from the data", name, value));
  };
  finite_not_negative(options.start_mm, "start_mm");
  finite_not_negative(options.noise_mm, "noise_mm");
}

}  // namespace

Registration register_joint(std::span<const RangeSurface> scans, const JointOptions& options) {
  if (scans.empty()) throw InputError("registration: there is no scan to register");
  check(options);
  const JointProblem problem = make_problem(scans, options);
  Registration result;
  const size_t n = scans.size();
  Poses tagged;
  for (const RangeSurface& s : scans) tagged.push_back(s.part_from_grid());
  const size_t samples = options.coarse_samples > 0 ? options.coarse_samples : 200;
  const double start_mm = options.start_mm > 0 ? options.start_mm : std::min(15.0, 3 * tag_sigma_mm(problem));
  // Good tags need no coarse stage: matches by projection find their way from a pixel or two.
  const bool near = start_mm <= 4 * problem.spacing_mm;

  // From the cheapest way to the most thorough; the first that is believed ends the search.
  std::vector<Attempt> attempts;
  const auto attempt = [&](const char* way, double fine_start_mm, auto&& find_poses) {
    if (!attempts.empty() && attempts.back().objection.empty()) return;
    Attempt a;
    a.way = way;
    a.poses = tagged;
    find_poses(a.poses);
    refine_and_judge(problem, fine_start_mm, a);
    attempts.push_back(std::move(a));
  };
  if (n > 1) {
    if (near) attempt("from the tags", start_mm, [](Poses&) {});
    attempt("coarse to fine", problem.fine_start_mm(),
            [&](Poses& poses) { coarse_stages(problem, start_mm, 0.85, samples, poses); });
    attempt("coarse to fine, wider and slower", problem.fine_start_mm(), [&](Poses& poses) {
      coarse_stages(problem, std::max(25.0, 2 * start_mm), 0.93, samples, poses);
    });
    if (n <= kFew && !attempts.back().objection.empty()) {
      for (const Poses& arrangement : search_arrangements(problem, tagged, kArrangements))
        attempt("several arrangements at a time", problem.fine_start_mm(),
                [&](Poses& poses) { poses = arrangement; });
    }
    const auto search = [&](bool doubt_violators) {
      return [&, doubt_violators](Poses& poses) {
        const Attempt& before = least_violating(attempts);
        poses = recover(problem, before.poses, suspects(before, doubt_violators), options.global_fallback);
      };
    };
    attempt("scan by scan from many starts", problem.fine_start_mm(), search(false));
    attempt("scan by scan from many starts, violators first", problem.fine_start_mm(), search(true));
  } else {
    Attempt alone;
    alone.way = "one scan is its own result";
    alone.poses = tagged;
    alone.sigma_mm = problem.noise_mm;
    alone.evidence.scans.resize(1);
    attempts.push_back(alone);
  }
  Attempt* best = &attempts.back();
  if (!best->objection.empty()) best = &least_violating(attempts);
  result.way = best->way;
  result.reason = best->objection;
  result.wobble_mm = best->wobble_mm;
  result.iterations = static_cast<int>(attempts.size());

  // The last rounds, on all pixels.
  const Pairs& pairs = best->evidence.pairs;
  std::vector<ActiveBlocks> active;
  align_fine(problem, pairs, {3 * best->sigma_mm, kPolishSamples, 4}, best->poses, &active);
  MatchGates gates;
  gates.stride = 1;
  gates.scale_mm = std::max(3 * 1.4142 * problem.noise_mm, 3 * best->sigma_mm);
  gates.reach_mm = 3 * gates.scale_mm;
  gates.max_angle_rad = 0.35;
  gates.normal_variance = problem.normal_variance;
  std::vector<PairSum> sums;
  std::vector<std::vector<BlockSum>> blocks;
  EdgeEvidence edges;
  if (!pairs.empty()) {
    const auto step_by = [&](const std::vector<PairSum>& by) {
      apply_step(problem, equations_of(problem, pairs, best->poses, by, best->sigma_mm).solve(), best->poses);
    };
    step_by(match_all(problem, pairs, best->poses, gates, nullptr, &active));
    sums = match_all(problem, pairs, best->poses, gates, &blocks, &active, &edges);
    const std::vector<double> others = leave_one_out(problem, pairs, best->poses, sums, best->sigma_mm);
    step_by(sums);
    result.scans.resize(n);
    for (size_t i = 0; i < n; ++i) result.scans[i].leave_one_out_mm = others[i];
  }
  result.scans.resize(n);

  const TagPrior::ChiSquare from_tags = problem.tag_prior.chi_square(errors_of_tags(problem, best->poses));
  result.shared_chi_square = from_tags.shared;
  const PoseCovariance covariance = pose_covariance(problem, pairs, sums, blocks, edges);
  const Pose gauge = tagged[0] * best->poses[0].inverse();
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = gauge.linear();
  turn.bottomRightCorner<3, 3>() = gauge.linear();
  const double uncertain_mm = std::max(kUncertain_mm, kUncertainInSigmas * best->sigma_mm);
  std::vector<size_t> uncertain;
  for (size_t i = 0; i < n; ++i) {
    ScanReport& report = result.scans[i];
    const ScanEvidence& evidence = best->evidence.scans[i];
    const Agreement& a = evidence.agreement;
    const double on_data = static_cast<double>(std::max<size_t>(1, a.tested - a.background));
    report.rms_mm = a.matched > 0 ? std::sqrt(a.squares / static_cast<double>(a.matched)) : 0;
    report.matches = a.matched;
    report.free_space_violation = static_cast<double>(a.in_front) / on_data;
    report.opposite_contact = static_cast<double>(a.contact) / on_data;
    report.connected = evidence.connected;
    report.prior_chi_square = from_tags.own[i];

    UncertainPose pose;
    pose.mean = i == 0 ? scans[0].part_from_sensor.mean
                       : gauge * best->poses[i] * scans[i].sensor_from_grid.inverse();
    if (i > 0) {
      const Matrix6d about_centre = turn * covariance.of(i) * turn.transpose();
      report.observability = observability_in_words(about_centre, problem.radius_mm, uncertain_mm);
      pose.independent = shifted_covariance(about_centre, gauge * problem.centre, Eigen::Vector3d::Zero());
      Vector6d unit;
      unit << Eigen::Vector3d::Constant(problem.radius_mm), Eigen::Vector3d::Ones();
      const Matrix6d scaled = unit.asDiagonal() * about_centre * unit.asDiagonal();
      if (Eigen::SelfAdjointEigenSolver<Matrix6d>(scaled).eigenvalues()(5) > uncertain_mm * uncertain_mm)
        uncertain.push_back(i);
    } else {
      report.observability = "the reference";
    }
    result.part_from_sensor.push_back(pose);
  }
  for (size_t k = 0; k < pairs.size(); ++k) {
    PairReport pair;
    pair.target = pairs[k].first;
    pair.source = pairs[k].second;
    pair.odometry = pair.source == pair.target + 1;
    Agreement both = best->evidence.agreements[2 * k];
    both += best->evidence.agreements[2 * k + 1];
    pair.overlap = static_cast<double>(both.matched) / static_cast<double>(std::max<size_t>(1, both.tested));
    pair.predicted_overlap = pair.overlap;
    pair.inliers = sums[2 * k].matches + sums[2 * k + 1].matches;
    const double weight = sums[2 * k].weight + sums[2 * k + 1].weight;
    pair.rms_mm = weight > 0 ? std::sqrt((sums[2 * k].cost + sums[2 * k + 1].cost) / weight) : 0;
    result.pairs.push_back(pair);
  }
  const double worst_leave_one_out_mm =
      std::max(kWorstLeaveOneOut_mm, kWorstLeaveOneOutInSigmas * best->sigma_mm);
  const double worst_prior_chi_square = chi_square_limit(6);
  if (result.reason.empty())
    for (size_t i = 0; i < n; ++i) {
      const ScanReport& report = result.scans[i];
      if (report.prior_chi_square > worst_prior_chi_square)
        result.reason = text(
            "%s ended further from its tagged pose than the tag's covariance allows "
            "(chi-square %.0f, limit %.0f)",
            scans[i].name.c_str(), report.prior_chi_square, worst_prior_chi_square);
      if (report.leave_one_out_mm > worst_leave_one_out_mm)
        result.reason =
            text("%s contradicts the others: without it they would move by %.2f mm (limit %.2f mm)",
                 scans[i].name.c_str(), report.leave_one_out_mm, worst_leave_one_out_mm);
    }
  const double worst_shared = chi_square_limit(static_cast<double>(problem.tag_prior.parameters()));
  if (result.reason.empty() && result.shared_chi_square > worst_shared)
    result.reason = text(
        "the scans together ended further from their tagged poses than the stated calibration allows "
        "(chi-square %.0f, limit %.0f)",
        result.shared_chi_square, worst_shared);
  if (result.reason.empty() && !uncertain.empty())
    result.reason = text("%s is not held well enough: ", scans[uncertain[0]].name.c_str()) +
                    result.scans[uncertain[0]].observability;
  result.converged = true;
  result.parameters = choices_of(problem, options, start_mm, best->sigma_mm, edges.sigma_mm);
  return result;
}

}  // namespace gantry
