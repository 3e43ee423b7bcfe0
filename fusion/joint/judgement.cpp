#include "joint/judgement.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "joint/align_fine.h"

namespace gantry::internal {
namespace {

constexpr double kEvidenceSamples = 4000;
constexpr size_t kWobbleSamples = 2500;
constexpr double kPush_mm = 2;

/// The two eigenvectors of least eigenvalue of a positive matrix, weakest first, by subspace iteration.
Eigen::MatrixXd weakest_directions(const Eigen::MatrixXd& matrix) {
  constexpr Eigen::Index kVectors = 6;
  const Eigen::Index size = matrix.rows();
  Eigen::MatrixXd shifted = matrix;
  shifted.diagonal().array() += 1e-12 * matrix.diagonal().maxCoeff();
  const Eigen::LDLT<Eigen::MatrixXd> root(shifted);
  Eigen::MatrixXd basis(size, kVectors);
  for (Eigen::Index i = 0; i < size; ++i)
    for (Eigen::Index k = 0; k < kVectors; ++k)
      basis(i, k) = std::sin(static_cast<double>(1 + (i + 1) * (2 * k + 3)));  // in no special direction
  for (int round = 0; round < 20; ++round)
    basis = Eigen::HouseholderQR<Eigen::MatrixXd>(root.solve(basis)).householderQ() *
            Eigen::MatrixXd::Identity(size, kVectors);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> small(basis.transpose() * matrix * basis);
  return basis * small.eigenvectors().leftCols(2);
}

/// How far each scan that takes part went from one set of poses to another, against the median of them all.
std::vector<double> apart_from_most_mm(const JointProblem& problem, const std::vector<bool>& takes_part,
                                       const Poses& from, const Poses& to) {
  std::vector<double> apart(problem.size(), 0);
  std::vector<size_t> scans;
  for (size_t i = 0; i < problem.size(); ++i)
    if (takes_part[i]) scans.push_back(i);
  if (scans.empty()) return apart;
  Eigen::MatrixXd motions(6, static_cast<Eigen::Index>(scans.size()));
  for (size_t k = 0; k < scans.size(); ++k)
    motions.col(static_cast<Eigen::Index>(k)) =
        log_about(problem.centre, to[scans[k]] * from[scans[k]].inverse());
  Vector6d middle;
  for (Eigen::Index row = 0; row < 6; ++row) {
    Eigen::VectorXd values = motions.row(row);
    std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
    middle[row] = values[values.size() / 2];
  }
  for (size_t k = 0; k < scans.size(); ++k) {
    const Vector6d own = motions.col(static_cast<Eigen::Index>(k)) - middle;
    apart[scans[k]] = own.tail<3>().norm() + problem.radius_mm * own.head<3>().norm();
  }
  return apart;
}

}  // namespace

Agreement Evidence::agreement_of(size_t a, size_t b) const {
  Agreement both = agreements[a * scans.size() + b];
  both += agreements[b * scans.size() + a];
  return both;
}

void Evidence::leave_out(const std::vector<bool>& scans_left_out) {
  const size_t n = scans.size();
  scans.assign(n, {});
  worst_violation = 0;
  for (size_t i = 0; i < n; ++i) {
    ScanEvidence& scan = scans[i];
    for (size_t other = 0; other < n; ++other)
      if (other != i && !scans_left_out[other]) scan.agreement += agreement_of(i, other);
    const Agreement& a = scan.agreement;
    const double on_data = static_cast<double>(a.tested - a.background);
    scan.violation = on_data > 0 ? static_cast<double>(a.in_front + a.contact) / on_data : 0;
    if (!scans_left_out[i]) worst_violation = std::max(worst_violation, scan.violation);
  }
  pairs.clear();
  pairs_of_left_out.clear();
  for (const auto& pair : all_pairs) {
    const int out = scans_left_out[pair.first] + scans_left_out[pair.second];
    if (out < 2) (out == 0 ? pairs : pairs_of_left_out).push_back(pair);
  }
  std::vector<bool> reached(n, false);
  reached[0] = true;
  for (bool grew = true; grew;) {
    grew = false;
    for (const auto& [a, b] : pairs)
      if (reached[a] != reached[b]) reached[a] = reached[b] = grew = true;
  }
  for (size_t i = 0; i < n; ++i) scans[i].connected = reached[i];
  for (const auto& [a, b] : pairs_of_left_out) {
    scans[a].connected = scans[a].connected || reached[b];
    scans[b].connected = scans[b].connected || reached[a];
  }
}

Evidence gather_evidence(const JointProblem& problem, const Poses& poses, double sigma_mm) {
  const size_t n = problem.size();
  Evidence evidence;
  evidence.scans.resize(n);
  const double tolerance_mm = std::max(6 * std::max(sigma_mm, problem.noise_mm), problem.spacing_mm);
  evidence.agreements.resize(n * n);
  tbb::parallel_for(size_t{0}, n * n, [&](size_t k) {
    const size_t target = k / n, source = k % n;
    if (target == source) return;
    const RangeSurface& s = problem.scans[source];
    const int stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(s.usable) /
                                                              (kEvidenceSamples * problem.share_of_pair()))));
    evidence.agreements[k] =
        compare(problem.scans[target], s, poses[target].inverse() * poses[source], tolerance_mm, stride);
  });
  evidence.all_pairs = pairs_with_overlap(problem, poses, tolerance_mm);
  evidence.leave_out(std::vector<bool>(n, false));
  return evidence;
}

Wobble wobble(const JointProblem& problem, const Pairs& pairs, const Poses& poses) {
  Wobble result;
  result.scans_mm.resize(problem.size(), 0);
  if (problem.size() < 2) return result;
  std::vector<bool> takes_part(problem.size(), false);
  for (const auto& [a, b] : pairs) takes_part[a] = takes_part[b] = true;
  Poses settled = poses;
  MatchMemory at_rest;
  const EdgeModel edges =
      align_fine(problem, pairs, {3 * problem.noise_mm, kWobbleSamples, 6, {}, &at_rest}, settled).edges;
  MatchGates gates;
  gates.edges = edges;
  gates.scale_mm = 4 * problem.noise_mm;
  gates.reach_mm = 3 * gates.scale_mm;
  gates.stride =
      std::max(1, static_cast<int>(std::sqrt(static_cast<double>(problem.scans[0].usable) /
                                             static_cast<double>(problem.samples(kWobbleSamples)))));
  EdgeEvidence seen;
  const std::vector<PairSum> sums = match_all(problem, pairs, settled, gates, nullptr, nullptr, &seen);
  const NormalEquations equations = equations_of(problem, pairs, settled, sums, seen, problem.noise_mm);
  // Scan 0 held; lengths at the part's radius for rotations too.
  const auto free = static_cast<Eigen::Index>(6 * (problem.size() - 1));
  Eigen::VectorXd unit(free);
  for (Eigen::Index k = 0; k < free; ++k) unit[k] = k % 6 < 3 ? 1 / problem.radius_mm : 1;
  Eigen::MatrixXd hessian =
      unit.asDiagonal() * equations.hessian().bottomRightCorner(free, free) * unit.asDiagonal();
  const double stiffest = hessian.diagonal().maxCoeff();
  for (size_t i = 1; i < problem.size(); ++i) {
    if (takes_part[i]) continue;
    const auto at = static_cast<Eigen::Index>(6 * (i - 1));
    hessian.middleRows<6>(at).setZero();
    hessian.middleCols<6>(at).setZero();
    hessian.diagonal().segment<6>(at).setConstant(stiffest);
  }
  const Eigen::MatrixXd weak = weakest_directions(hessian);
  result.worst_mm = -1;
  for (int k = 0; k < 2; ++k) {
    Eigen::VectorXd push = Eigen::VectorXd::Zero(free + 6);
    push.tail(free) = unit.asDiagonal() * weak.col(k);
    double length = 0;
    for (size_t i = 1; i < problem.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(6 * i);
      length =
          std::max(length, push.segment<3>(at + 3).norm() + problem.radius_mm * push.segment<3>(at).norm());
    }
    push *= kPush_mm / length;
    Poses pushed = settled;
    apply_step(problem, push, pushed);
    MatchMemory memory = at_rest;
    align_fine(problem, pairs, {kPush_mm, kWobbleSamples, 14, edges, &memory}, pushed);
    const double left = difference_mm(problem, settled, pushed);
    if (left > result.worst_mm) {
      result.worst_mm = left;
      result.weakest = push;
    }
    const std::vector<double> scans_mm = apart_from_most_mm(problem, takes_part, settled, pushed);
    for (size_t i = 0; i < scans_mm.size(); ++i)
      result.scans_mm[i] = std::max(result.scans_mm[i], scans_mm[i]);
  }
  return result;
}

}  // namespace gantry::internal
