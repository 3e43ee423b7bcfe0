#include "joint/report.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "joint/words.h"

namespace gantry::internal {
namespace {

/// More are counted, not named, in one sentence; the report of each scan says why.
constexpr size_t kMostNamed = 5;

std::vector<ParameterChoice> choices_of(const JointProblem& problem, const JointOptions& options,
                                        double start_mm, double sigma_mm, const EdgeModel& edges) {
  return {
      {"noise_mm", problem.noise_mm,
       options.noise_mm > 0 ? "given" : "median over the scans, from second differences along rows"},
      {"spacing_mm", problem.spacing_mm, "median pixel pitch at the part"},
      {"normal_window_px", 2.0 * problem.scans[0].normal_window_px + 1,
       "smallest window in which noise tilts normals by less than 1.7 degrees"},
      {"start_mm", start_mm,
       options.start_mm > 0 ? "given"
                            : "three sigma of the tagged poses at the part's radius, at most 15 mm"},
      {"coarse_samples",
       static_cast<double>(options.coarse_samples > 0 ? options.coarse_samples
                                                      : problem.samples(kCoarseSamples)),
       options.coarse_samples > 0 ? "given" : "150 to 2000 serve alike, fewer where there are many scans"},
      {"max_partners", static_cast<double>(problem.max_partners),
       options.max_partners > 0 ? "given" : "the scans with most surface in common; more add nothing"},
      {"shared_parameters", static_cast<double>(problem.tag_prior.parameters()),
       problem.tag_prior.parameters() > 0
           ? "calibrated parameters of the cell, whose errors all tagged poses share"
           : "the tags do not say what their errors share: taken as independent"},
      {"edge_sigma_mm", edges.at_edges.sigma_mm,
       "of the edges at which surfaces end, pixel by pixel; the less they scatter, the more they count"},
      {"edge_offset_mm", edges.at_edges.offset_mm, "the same from edge to edge"},
      {"edge_pair_offset_mm", edges.at_edges.pair_offset_mm, "the same from one pair of scans to another"},
      {"edge_at_face_sigma_mm", edges.at_faces.sigma_mm,
       "of edges about the face of another scan at which they end, pixel by pixel"},
      {"edge_at_face_offset_mm", edges.at_faces.offset_mm, "the same from edge to edge"},
      {"edge_at_face_pair_offset_mm", edges.at_faces.pair_offset_mm,
       "the same from one pair of scans to another"},
      {"edge_break_mm", edges.break_mm,
       "how far before such a face they end on average: chamfers and roundings"},
      {"residual_sigma_mm", sigma_mm,
       "of the matches at the end; three times this is the final robust scale"},
      {"part_radius_mm", problem.radius_mm, "nine tenths of the surface lie nearer to the centre"}};
}

ScanReport scan_report(const JointProblem& problem, const Attempt& attempt, const Solution& solution,
                       size_t scan) {
  const ScanEvidence& evidence = attempt.evidence.scans[scan];
  const Agreement& a = evidence.agreement;
  const double on_data = static_cast<double>(std::max<size_t>(1, a.tested - a.background));
  ScanReport report;
  report.rms_mm = a.matched > 0 ? std::sqrt(a.squares / static_cast<double>(a.matched)) : 0;
  report.matches = a.matched;
  report.free_space_violation = static_cast<double>(a.in_front) / on_data;
  report.opposite_contact = static_cast<double>(a.contact) / on_data;
  report.connected = evidence.connected;
  report.prior_chi_square = solution.from_tags.own[scan];
  report.leave_one_out_mm = solution.leave_one_out_mm[scan];
  report.observability = observability_of(problem, attempt, solution, scan);
  report.left_out = attempt.left_out[scan];
  return report;
}

PairReport pair_report(const JointProblem& problem, const Attempt& attempt, const Solution& solution,
                       size_t k) {
  PairReport pair;
  pair.target = solution.pairs[k].first;
  pair.source = solution.pairs[k].second;
  pair.odometry = pair.source == pair.target + 1;
  const Agreement both = attempt.evidence.agreement_of(pair.target, pair.source);
  pair.overlap = static_cast<double>(both.matched) / static_cast<double>(std::max<size_t>(1, both.tested));
  pair.predicted_overlap = std::numeric_limits<double>::quiet_NaN();
  const PairSum &one = solution.sums[2 * k], &other = solution.sums[2 * k + 1];
  pair.inliers = one.matches + other.matches;
  const double weight = one.weight + other.weight;
  pair.rms_mm = weight > 0 ? std::sqrt((one.cost + other.cost) / weight) : 0;
  for (const size_t scan : {pair.target, pair.source}) {
    if (attempt.left_out[scan].empty()) continue;
    pair.kept = false;
    pair.reason = problem.scans[scan].name + " is left out";
  }
  return pair;
}

/// Who is left out and why, in one sentence.
std::string left_out_in_words(const JointProblem& problem, const Attempt& attempt) {
  const size_t count = attempt.left_out_count();
  std::string words = text("%zu of %zu scans left out, the others agree:", count, problem.size());
  size_t named = 0;
  for (size_t i = 0; i < problem.size() && named < kMostNamed; ++i) {
    if (attempt.left_out[i].empty()) continue;
    words += (named++ > 0 ? "; " : " ") + problem.scans[i].name + " " + attempt.left_out[i];
  }
  if (count > named) words += text("; and %zu more", count - named);
  return words;
}

}  // namespace

Registration report_of(const JointProblem& problem, const JointOptions& options, double start_mm,
                       const Attempt& attempt, const Solution& solution) {
  Registration result;
  result.way = attempt.way;
  result.converged = at_rest(problem, solution);
  result.wobble_mm = attempt.wobble.worst_mm;
  result.shared_chi_square = solution.from_tags.shared;
  result.reason = attempt.objection;
  if (result.reason.empty() && attempt.left_out_count() > options.allowed_left_out)
    result.reason = left_out_in_words(problem, attempt);
  for (size_t i = 0; i < problem.size(); ++i) {
    const RangeSurface& scan = problem.scans[i];
    UncertainPose pose;
    pose.mean = i == 0 ? scan.part_from_sensor.mean
                       : solution.gauge * solution.poses[i] * scan.sensor_from_grid.inverse();
    if (i > 0)
      pose.independent = shifted_covariance(solution.covariance[i], solution.gauge * problem.centre,
                                            Eigen::Vector3d::Zero());
    result.part_from_sensor.push_back(pose);
    result.scans.push_back(scan_report(problem, attempt, solution, i));
  }
  result.joint_covariance = carried_covariance(
      solution.joint_covariance, shifted_errors(solution.gauge * problem.centre, Eigen::Vector3d::Zero()));
  for (size_t k = 0; k < solution.pairs.size(); ++k)
    result.pairs.push_back(pair_report(problem, attempt, solution, k));
  result.parameters = choices_of(problem, options, start_mm, attempt.sigma_mm, solution.edges);
  return result;
}

}  // namespace gantry::internal
