#pragma once

#include <vector>

#include "joint/edge_evidence.h"
#include "joint/problem.h"

namespace gantry::internal {

/// Covariance of all poses' errors (twists about the problem's centre, in the part frame; 6 rows a scan), by
/// the jackknife over patches of the part's surface.
///
/// The model of correlation: residuals within one patch may be correlated in any way, those of different
/// patches are independent. Patches are cubes of `patch_mm` in the part frame, 64 pixels wide: whatever
/// shares a measured pixel (both ways of a pair, several pairs that see the same surface, the normals'
/// windows) or errs alike (a sensor's local distortion) falls into one patch, mostly. Leaving patch p out
/// would move the poses by d_p = (H - H_p)^-1 g_p; the covariance is the sum of d_p d_p^T over the patches
/// (cluster jackknife, CR3; Bell and McCaffrey 2002). It takes noise and the model's errors as they are, and
/// knows when a few patches alone hold a direction. H is the second derivative of the robust costs, without
/// what noise in the normals pretends to know (normal_equations.h).
///
/// What edges say is no such sum: it enters as information of which the errors are known (edge_evidence.h).
/// They scatter about a mean that all edges of one direction in a pair of scans have in common, and these
/// about one of the pair, because edges look different from different sides; both means are unknowns that are
/// taken out. Around a closed outline such offsets cancel.
///
/// A sum over few patches is itself uncertain, and with less than seven of them in effect (Satterthwaite)
/// says nothing of six directions at once. With nu in effect a share of 7 / nu of it is therefore replaced by
/// what independent pixels would leave, times the factor by which correlation enlarges that in the mean over
/// all scans (shrinkage; Ledoit and Wolf 2004). What is left of the jackknife's uncertainty enlarges the
/// whole: the inverse of a sum over nu patches is nu / (nu - 7) of the true one in the mean (inverse
/// Wishart).
///
/// Interpolation errs alike along all creases that a pair of scans shares (chord_errors.h), which patches do
/// not show either: for each scan on each other one, the motion that its chords alone would make is added as
/// an error of its own.
struct PoseCovariance {
  Eigen::MatrixXd moves;        ///< d_p of every patch, 6 n rows.
  Eigen::MatrixXd independent;  ///< What independent pixels would leave, 6 n x 6 n.
  double correlation = 1;  ///< How many times that the patches show, in the mean of scans and directions.
  Eigen::MatrixXd common;  ///< What the prior's own error, offsets of edges, and chords add, 6 n x 6 n.
  double patch_mm = 0;
  Matrix6d of(size_t scan) const;  ///< Errors of one scan against scan 0.
  /// Errors of all scans against scan 0, 6 n x 6 n: scans that lean on the same patches err together. Its
  /// diagonal blocks are those of of().
  Eigen::MatrixXd joint() const;
};

/// `chords`: chord_errors() of every slot.
PoseCovariance pose_covariance(const JointProblem& problem, const Pairs& pairs,
                               const std::vector<PairSum>& sums,
                               const std::vector<std::vector<BlockSum>>& blocks, const EdgeEvidence& edges,
                               const std::vector<Vector6d>& chords);

}  // namespace gantry::internal
