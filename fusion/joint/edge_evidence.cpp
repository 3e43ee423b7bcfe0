#include "joint/edge_evidence.h"

#include <algorithm>
#include <cmath>

#include "joint/problem.h"

namespace gantry::internal {
namespace {

/// An edge is not placed better than this by one of its pixels, in pitches, nor by all of them ...
constexpr double kEdgeSigma_px = 0.3, kEdgeOffset_px = 0.1;
/// ... and so many of them in a row say the same, because they share a window (surface_edges.h).
constexpr double kEdgePixelsAlike = 9;
/// Edges are broken by about this much unless these scans know better (ISO 13715 speaks of 0.1 to 0.5 mm).
constexpr double kUsualBreak_mm = 0.3;
/// Chamfers and fillets wider than this are surfaces of their own.
constexpr double kMostBroken_px = 8;

EdgeModel::Scatter scatter_of(const JointProblem& problem, const std::vector<RawSums>& sums,
                              EdgeSums RawSums::*kind) {
  double all = 0, weight = 0, offset = 0;
  double of_means = 0, of_pair_means = 0, of_mean = 0;  // squares
  for (const RawSums& s : sums) {
    PairSum pair;
    for (const PairSum& one : s.*kind) {
      pair += one;
      if (one.weight > 0) of_means += one.offset * one.offset / one.weight;
    }
    if (!(pair.weight > 0)) continue;
    of_pair_means += pair.offset * pair.offset / pair.weight;
    all += pair.cost;
    weight += pair.weight;
    offset += pair.offset;
  }
  const double least_mm = kEdgeOffset_px * problem.spacing_mm,
               least_sigma_mm = std::max(problem.noise_mm, kEdgeSigma_px * problem.spacing_mm);
  if (!(weight > 0)) return {least_sigma_mm, least_mm, least_mm};
  of_mean = offset * offset / weight;
  const auto root = [&](double squares) { return std::sqrt(std::max(0.0, squares) / weight); };
  return {std::max(root(all - of_means), least_sigma_mm), std::max(root(of_means - of_pair_means), least_mm),
          std::max(root(of_pair_means - of_mean), least_mm)};
}

/// Takes an offset that all these residuals have in common out of what they say, sums being in units of
/// 1/mm^2; the offset is known only to be about as large as `sigma_mm` (Schur complement).
void marginalise(PairSum& sum, double sigma_mm) {
  const double variance = sigma_mm * sigma_mm, left = 1 / (1 + variance * sum.weight);
  sum.hessian -= variance * left * sum.directions * sum.directions.transpose();
  sum.gradient -= variance * left * sum.offset * sum.directions;
  sum.directions *= left;
  sum.offset *= left;
  sum.weight *= left;
}

/// What edges say of a pair, in units of 1/mm^2, each matched pixel standing for `count` that err by chance.
PairSum weighed(const EdgeSums& sums, const EdgeModel::Scatter& scatter, double count) {
  const double each = count / std::pow(scatter.sigma_mm, 2);
  PairSum pair;
  for (PairSum one : sums) {
    if (!(one.weight > 0)) continue;
    const Matrix6d factor = one.take_out_tilts();
    one.hessian *= each;
    one.gradient *= each;
    one.directions = each * factor * one.directions;
    one.offset *= each;
    one.weight *= each;
    marginalise(one, scatter.offset_mm);
    pair += one;
  }
  marginalise(pair, scatter.pair_offset_mm);
  return pair;
}

}  // namespace

EdgeModel edge_model(const JointProblem& problem, const std::vector<RawSums>& raw, EdgeModel model) {
  if (!(model.at_edges.sigma_mm > 0)) model.at_edges = scatter_of(problem, raw, &RawSums::edges);
  if (!(model.at_faces.sigma_mm > 0)) model.at_faces = scatter_of(problem, raw, &RawSums::faces);
  return model;
}

EdgeEvidence add_edges(const std::vector<RawSums>& raw, const EdgeModel& model, double surface_variance,
                       int stride, const std::vector<size_t>& edge_steps, std::vector<PairSum>& sums) {
  EdgeEvidence evidence;
  evidence.model = model;
  evidence.break_hessian = surface_variance / (kUsualBreak_mm * kUsualBreak_mm);
  evidence.break_gradient = evidence.break_hessian * model.break_mm;
  // What was skipped, of edges and of pixels, must not change how much they count against each other.
  const double share = surface_variance / (stride * stride);
  for (size_t slot = 0; slot < raw.size(); ++slot) {
    const double count = static_cast<double>(edge_steps[slot]) / kEdgePixelsAlike;
    const PairSum edges = weighed(raw[slot].edges, model.at_edges, count),
                  faces = weighed(raw[slot].faces, model.at_faces, count);
    evidence.hessians.push_back(share * (edges.hessian + faces.hessian));
    evidence.by_break.push_back(share * faces.directions);
    evidence.break_hessian += share * faces.weight;
    evidence.break_gradient += share * faces.offset;
    sums[slot].hessian += evidence.hessians.back();
    sums[slot].gradient += share * (edges.gradient + faces.gradient);
  }
  return evidence;
}

Eigen::VectorXd by_break(const JointProblem& problem, const Pairs& pairs, const EdgeEvidence& edges) {
  Eigen::VectorXd mixed = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(6 * problem.size()));
  const Slots slots{pairs};
  for (size_t slot = 0; slot < edges.by_break.size(); ++slot) {
    mixed.segment<6>(static_cast<Eigen::Index>(6 * slots.source(slot))) += edges.by_break[slot];
    mixed.segment<6>(static_cast<Eigen::Index>(6 * slots.target(slot))) -= edges.by_break[slot];
  }
  return mixed;
}

double broken_after(const JointProblem& problem, const Pairs& pairs, const EdgeEvidence& edges,
                    const Eigen::VectorXd& step) {
  const double more =
      -(edges.break_gradient + by_break(problem, pairs, edges).dot(step)) / edges.break_hessian;
  return std::clamp(edges.model.break_mm + more, 0.0, kMostBroken_px * problem.spacing_mm);
}

}  // namespace gantry::internal
