#include "joint/covariance.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "joint/leave_out.h"

namespace gantry::internal {
namespace {

/// Many times what shares a measured pixel.
constexpr double kLeastPatch_px = 64;
/// One more than the dimensions: so few patches say nothing of a covariance's shape.
constexpr double kFewPatches = 7;

/// Of the least that the prior knows: enough against rounding, and too little to be taken for knowledge.
constexpr double kLeast = 1e-3;

using PatchKey = std::array<int, 3>;

/// Covariance of a scan's errors against scan 0's.
Matrix6d relative(const Eigen::MatrixXd& covariance, size_t scan) {
  const auto i = static_cast<Eigen::Index>(6 * scan);
  return covariance.block<6, 6>(i, i) + covariance.block<6, 6>(0, 0) - covariance.block<6, 6>(i, 0) -
         covariance.block<6, 6>(0, i);
}

/// What the patches say of one scan's errors.
struct Shown {
  Matrix6d by_patches, independent;
  double patches;      ///< In effect (Satterthwaite).
  double correlation;  ///< How many times the one is the other, in the mean of six directions.
};

Shown shown_of(const PoseCovariance& all, size_t scan) {
  const auto i = static_cast<Eigen::Index>(6 * scan);
  const Eigen::Matrix<double, 6, Eigen::Dynamic> its = all.moves.middleRows<6>(i) - all.moves.topRows<6>();
  Shown shown{its * its.transpose(), relative(all.independent, scan), 0, 0};
  // Radians and millimetres differ: unit diagonal first.
  const Vector6d scale = shown.independent.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Matrix6d scaled = scale.asDiagonal() * shown.independent * scale.asDiagonal();
  const Eigen::LLT<Matrix6d> root((scaled + 1e-9 * Matrix6d::Identity()).eval());
  const Eigen::VectorXd shares =
      root.matrixL().solve(scale.asDiagonal() * its).colwise().squaredNorm().transpose();
  shown.correlation = shares.sum() / 6;
  shown.patches = shares.squaredNorm() > 0 ? shares.sum() * shares.sum() / shares.squaredNorm() : 0;
  return shown;
}

/// How much of a covariance the patches say, and how much what independent pixels would leave.
struct Mixture {
  double patches, independent;
};

Mixture mixture_of(double patches) {
  const double trusted = 1 - kFewPatches / std::max(patches, kFewPatches);
  const double in_effect = trusted > 0 ? patches / (trusted * trusted) : 0;
  const double enlarged = trusted > 0 ? in_effect / (in_effect - kFewPatches) : 1;
  return {enlarged * trusted, enlarged * (1 - trusted)};
}

/// The first scan's rows taken from all others' and from its own.
Eigen::MatrixXd against_first(Eigen::MatrixXd rows) {
  for (Eigen::Index i = rows.rows() - 6; i >= 0; i -= 6) rows.middleRows<6>(i) -= rows.topRows<6>().eval();
  return rows;
}

/// A root of a covariance: root * root^T. What is smaller than rounding counts as that.
Matrix6d root_of(const Matrix6d& covariance) {
  const Vector6d scale = covariance.diagonal().cwiseMax(1e-300).cwiseSqrt();
  const Matrix6d scaled = scale.cwiseInverse().asDiagonal() * covariance * scale.cwiseInverse().asDiagonal();
  const Eigen::LLT<Matrix6d> root((scaled + 1e-12 * Matrix6d::Identity()).eval());
  return scale.asDiagonal() * Matrix6d(root.matrixL());
}

}  // namespace

Matrix6d PoseCovariance::of(size_t scan) const {
  const Shown shown = shown_of(*this, scan);
  const Mixture mixture = mixture_of(shown.patches);
  return mixture.patches * shown.by_patches + mixture.independent * correlation * shown.independent +
         relative(common, scan);
}

Eigen::MatrixXd PoseCovariance::joint() const {
  const auto dimension = independent.rows();
  const Eigen::Index scans = dimension / 6;
  // Few patches in effect here and many there: the mean mixture first, then each scan's own block.
  Mixture mean{0, 0};
  for (Eigen::Index i = 1; i < scans; ++i) {
    const Mixture own = mixture_of(shown_of(*this, static_cast<size_t>(i)).patches);
    mean.patches += own.patches / static_cast<double>(scans - 1);
    mean.independent += own.independent / static_cast<double>(scans - 1);
  }
  const Eigen::MatrixXd its = against_first(moves);
  const Eigen::MatrixXd others =
      against_first(against_first(mean.independent * correlation * independent + common).transpose());
  Eigen::MatrixXd all = mean.patches * its * its.transpose() + others;
  Eigen::MatrixXd to_own = Eigen::MatrixXd::Zero(dimension, dimension);
  for (Eigen::Index i = 1; i < scans; ++i)
    to_own.block<6, 6>(6 * i, 6 * i) =
        root_of(of(static_cast<size_t>(i))) * root_of(all.block<6, 6>(6 * i, 6 * i)).inverse();
  return to_own * all * to_own.transpose();
}

PoseCovariance pose_covariance(const JointProblem& problem, const Pairs& pairs,
                               const std::vector<PairSum>& sums,
                               const std::vector<std::vector<BlockSum>>& blocks, const EdgeEvidence& edges,
                               const std::vector<Vector6d>& chords) {
  const size_t n = problem.size();
  const auto dimension = static_cast<Eigen::Index>(6 * n);
  const Slots slots{pairs};
  PoseCovariance result;
  int window = 0;
  for (const RangeSurface& s : problem.scans) window = std::max(window, 2 * s.normal_window_px + 1);
  result.patch_mm = problem.spacing_mm * std::max(kLeastPatch_px, 4.0 * window);

  // For each patch, the sums of every pair that has matches in it.
  std::map<PatchKey, std::map<size_t, PairSum>> patches;
  for (size_t slot = 0; slot < blocks.size(); ++slot) {
    for (const BlockSum& block : blocks[slot]) {
      PatchKey key;
      for (int axis = 0; axis < 3; ++axis)
        key[axis] =
            static_cast<int>(std::floor((block.place[axis] - problem.centre[axis]) / result.patch_mm));
      PairSum& sum = patches[key][slot];
      sum.hessian += block.hessian.cast<double>();
      sum.gradient += block.gradient.cast<double>();
    }
  }
  // All information here is in units of one over the variance of a surface's residual, as the sums have it.
  NormalEquations equations(n);
  double cost = 0, weight = 0;
  for (size_t slot = 0; slot < sums.size(); ++slot) {
    equations.add_pair(slots.target(slot), slots.source(slot), sums[slot]);
    cost += sums[slot].cost;
    weight += sums[slot].weight;
  }
  NormalEquations of_edges(n);
  for (size_t slot = 0; slot < edges.hessians.size(); ++slot) {
    PairSum sum;
    sum.hessian = edges.hessians[slot];
    of_edges.add_pair(slots.target(slot), slots.source(slot), sum);
  }
  const Eigen::MatrixXd of_surfaces = equations.hessian() - of_edges.hessian();
  const Eigen::VectorXd mixed = by_break(problem, pairs, edges);
  of_edges.eliminate(mixed, edges.break_hessian, 0);
  equations.eliminate(mixed, edges.break_hessian, 0);
  const double variance = weight > 0 ? std::max(cost / weight, 1e-12) : 1;
  equations.add_prior(variance * problem.tag_prior.information(), Eigen::VectorXd::Zero(dimension));

  // Scaled to displacements at the part's radius before inverting. Where taking the tilts out left nothing
  // or less, the data say nothing: such directions are given the widest uncertainty that the prior allows.
  Eigen::VectorXd unit(dimension);
  for (Eigen::Index k = 0; k < dimension; ++k) unit[k] = k % 6 < 3 ? 1 / problem.radius_mm : 1;
  const double least = variance * std::max(kLeast * problem.tag_prior.weakest(unit.head<6>()), 1e-9);
  Eigen::MatrixXd all = unit.asDiagonal() * equations.hessian() * unit.asDiagonal();
  all.diagonal().array() += least;
  const LeaveOut leave_out(all);

  // How far each patch alone moves the poses, and what the prior's own error does.
  std::vector<const std::map<size_t, PairSum>*> order;
  for (const auto& [key, patch] : patches) order.push_back(&patch);
  result.moves.resize(dimension, static_cast<Eigen::Index>(order.size()));
  tbb::parallel_for(size_t{0}, order.size(), [&](size_t p) {
    std::vector<size_t> scans;
    for (const auto& [slot, sum] : *order[p]) {
      scans.push_back(slots.target(slot));
      scans.push_back(slots.source(slot));
    }
    std::sort(scans.begin(), scans.end());
    scans.erase(std::unique(scans.begin(), scans.end()), scans.end());
    const auto place = [&](size_t scan) {
      return static_cast<size_t>(std::lower_bound(scans.begin(), scans.end(), scan) - scans.begin());
    };
    NormalEquations its(scans.size());
    for (const auto& [slot, sum] : *order[p]) {
      its.add_pair(place(slots.target(slot)), place(slots.source(slot)), sum, 1);
    }
    const auto size = static_cast<Eigen::Index>(6 * scans.size());
    const Eigen::MatrixXd part = unit.head(size).asDiagonal() * its.hessian() * unit.head(size).asDiagonal();
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(dimension);
    for (size_t k = 0; k < scans.size(); ++k)
      gradient.segment<6>(static_cast<Eigen::Index>(6 * scans[k])) =
          unit.head<6>().asDiagonal() * its.gradient().segment<6>(static_cast<Eigen::Index>(6 * k));
    result.moves.col(static_cast<Eigen::Index>(p)) =
        unit.asDiagonal() * leave_out.solve(scans, part, gradient);
  });
  const Eigen::MatrixXd inverse = unit.asDiagonal() * leave_out.inverse() * unit.asDiagonal();
  result.common = inverse * (variance * variance * problem.tag_prior.information()) * inverse;
  // Edges are weighed by what is known of their errors, so that they count as any other prior.
  result.common += inverse * (variance * of_edges.hessian()) * inverse;
  for (size_t slot = 0; slot < chords.size(); ++slot) {
    const auto target = static_cast<Eigen::Index>(6 * slots.target(slot)),
               source = static_cast<Eigen::Index>(6 * slots.source(slot));
    const Eigen::VectorXd moved =
        (inverse.middleCols<6>(source) - inverse.middleCols<6>(target)) * chords[slot];
    result.common += moved * moved.transpose();
  }
  result.independent = inverse * (variance * of_surfaces) * inverse;
  double correlations = 0, all_patches = 0;
  for (size_t i = 1; i < n; ++i) {
    const Shown shown = shown_of(result, i);
    correlations += shown.patches * shown.correlation;
    all_patches += shown.patches;
  }
  if (all_patches > 0) result.correlation = correlations / all_patches;
  return result;
}

}  // namespace gantry::internal
