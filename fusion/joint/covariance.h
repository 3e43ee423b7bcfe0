#pragma once

#include <vector>

#include "joint/problem.h"

namespace gantry::internal {

/// Covariance of all poses' errors (twists about the problem's centre, in the part frame; 6 rows a scan), by
/// the jackknife over patches of the part's surface.
///
/// The model of correlation: residuals within one patch may be correlated in any way, those of different
/// patches are independent. Patches are cubes of `patch_mm` in the part frame, 64 pixels wide: whatever
/// shares a measured pixel (both ways of a pair, several pairs that see the same surface, the normals'
/// windows) or errs alike (interpolation along a crease, a sensor's local distortion) falls into one patch,
/// mostly. Leaving patch p out would move the poses by d_p = (H - H_p)^-1 g_p; the covariance is the sum of
/// d_p d_p^T over the patches (cluster jackknife, CR3; Bell and McCaffrey 2002). It takes noise and the
/// model's errors as they are, and knows when a few patches alone hold a direction. H is the second
/// derivative of the robust costs, without what noise in the normals pretends to know (normal_equations.h).
///
/// Edges err alike wherever a scan sees them (pixels at the border are lost; rounded edges end elsewhere when
/// seen from elsewhere), which no patch can show: all edges of a scan standing out by a common offset, with
/// the standard deviation by which edges scatter, adds its own part for each scan. Around a closed outline
/// such offsets cancel.
///
/// A sum over few patches is itself uncertain: with nu of them in effect (Satterthwaite), the inverse of what
/// they show is nu / (nu - 7) of the true one in the mean (six dimensions; inverse Wishart), and the
/// covariance is enlarged by that.
struct PoseCovariance {
  Eigen::MatrixXd moves;   ///< d_p of every patch, 6 n rows.
  Eigen::MatrixXd common;  ///< What the prior's own error and the offsets of edges add, 6 n x 6 n.
  double patch_mm = 0;
  Matrix6d of(size_t scan) const;  ///< Errors of one scan against scan 0.
};

PoseCovariance pose_covariance(const JointProblem& problem, const Pairs& pairs,
                               const std::vector<PairSum>& sums,
                               const std::vector<std::vector<BlockSum>>& blocks, const EdgeEvidence& edges);

}  // namespace gantry::internal
