#pragma once

#include <Eigen/Core>
#include <vector>

namespace gantry::internal {

/// Covariance of a weighted least-squares fit whose residuals are correlated with their neighbours':
/// a sandwich over patches, each patch's gradient set right for what the fit has already taken of its
/// residuals (Bell and McCaffrey, 2002: "CR2", exact when all residuals are alike), shrunk towards
/// "all directions alike, in units of what the fit holds" as far as the scatter between patches asks for, and
/// widened for their small number, so that regions by chi-square hold what those by Fisher's F would.
/// `curvature` is the full Hessian (positive definite), `part[p]` a patch's share of it, `gradient[p]` its
/// gradient at the fit, where all of them together cancel.
Eigen::MatrixXd patch_covariance(const Eigen::MatrixXd& curvature, const std::vector<Eigen::MatrixXd>& part,
                                 const std::vector<Eigen::VectorXd>& gradient);

/// Numbers points by which way their normals face (along which of +-x, +-y, +-z most) and by the squares of
/// `edge_mm` that they lie in seen along that axis: from 0, without gaps, in order of first appearance.
std::vector<int> patches_of(const std::vector<Eigen::Vector3d>& points,
                            const std::vector<Eigen::Vector3d>& normals, double edge_mm);

}  // namespace gantry::internal
