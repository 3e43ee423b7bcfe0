#include "joint/judgement.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

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

}  // namespace

Evidence gather_evidence(const JointProblem& problem, const Poses& poses, double sigma_mm) {
  const size_t n = problem.size();
  Evidence evidence;
  evidence.scans.resize(n);
  const double tolerance_mm = std::max(6 * std::max(sigma_mm, problem.noise_mm), problem.spacing_mm);
  std::vector<Agreement> all(n * n);
  tbb::parallel_for(size_t{0}, n * n, [&](size_t k) {
    const size_t target = k / n, source = k % n;
    if (target == source) return;
    const RangeSurface& s = problem.scans[source];
    const int stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(s.usable) /
                                                              (kEvidenceSamples * problem.share_of_pair()))));
    all[k] = compare(problem.scans[target], s, poses[target].inverse() * poses[source], tolerance_mm, stride);
  });
  for (size_t target = 0; target < n; ++target)
    for (size_t source = 0; source < n; ++source) {
      evidence.scans[target].agreement += all[target * n + source];
      evidence.scans[source].agreement += all[target * n + source];
    }
  double matched = 0, violated = 0;
  for (ScanEvidence& scan : evidence.scans) {
    const Agreement& a = scan.agreement;
    const double on_data = static_cast<double>(a.tested - a.background);
    scan.violation = on_data > 0 ? static_cast<double>(a.in_front + a.contact) / on_data : 0;
    scan.background = a.tested > 0 ? static_cast<double>(a.background) / static_cast<double>(a.tested) : 0;
    evidence.worst_violation = std::max(evidence.worst_violation, scan.violation);
    evidence.worst_background = std::max(evidence.worst_background, scan.background);
    matched += static_cast<double>(a.matched);
    violated += static_cast<double>(a.in_front + a.contact) + 0.5 * static_cast<double>(a.background);
  }
  evidence.score = (matched - violated) / std::max(1.0, matched + violated);

  evidence.pairs = pairs_with_overlap(problem, poses, tolerance_mm);
  for (const auto& [a, b] : evidence.pairs) {
    evidence.agreements.push_back(all[a * n + b]);
    evidence.agreements.push_back(all[b * n + a]);
  }
  std::vector<bool> reached(n, false);
  reached[0] = true;
  for (bool grew = true; grew;) {
    grew = false;
    for (const auto& [a, b] : evidence.pairs)
      if (reached[a] != reached[b]) reached[a] = reached[b] = grew = true;
  }
  for (size_t i = 0; i < n; ++i) {
    evidence.scans[i].connected = reached[i];
    evidence.all_connected = evidence.all_connected && reached[i];
  }
  return evidence;
}

double wobble_mm(const JointProblem& problem, const Pairs& pairs, const Poses& poses,
                 Eigen::VectorXd* weakest) {
  if (problem.size() < 2) return 0;
  Poses settled = poses;
  const double edge_sigma_mm =
      align_fine(problem, pairs, {3 * problem.noise_mm, kWobbleSamples, 6}, settled).edge_sigma_mm;
  MatchGates gates;
  gates.edge_sigma_mm = edge_sigma_mm;
  gates.scale_mm = 4 * problem.noise_mm;
  gates.reach_mm = 3 * gates.scale_mm;
  gates.stride = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(problem.scans[0].usable) /
                                                        static_cast<double>(kWobbleSamples))));
  const NormalEquations equations =
      equations_of(problem, pairs, settled, match_all(problem, pairs, settled, gates), problem.noise_mm);
  // Scan 0 held; lengths at the part's radius for rotations too.
  const auto free = static_cast<Eigen::Index>(6 * (problem.size() - 1));
  Eigen::VectorXd unit(free);
  for (Eigen::Index k = 0; k < free; ++k) unit[k] = k % 6 < 3 ? 1 / problem.radius_mm : 1;
  const Eigen::MatrixXd weak = weakest_directions(
      unit.asDiagonal() * equations.hessian().bottomRightCorner(free, free) * unit.asDiagonal());
  double worst = -1;
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
    align_fine(problem, pairs, {kPush_mm, kWobbleSamples, 14, edge_sigma_mm}, pushed);
    const double left = difference_mm(problem, settled, pushed);
    if (left > worst) {
      worst = left;
      if (weakest) *weakest = push;
    }
  }
  return worst;
}

}  // namespace gantry::internal
