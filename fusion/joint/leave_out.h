#pragma once

#include <Eigen/Core>
#include <vector>

namespace gantry::internal {

/// Solves (H - P) x = b for many parts P of the normal equations H that each touch few scans, at the price of
/// a small system each (Woodbury): what would the poses be without this patch, without this scan?
class LeaveOut {
 public:
  /// `hessian` is 6 n x 6 n and positive definite; if it is not, all answers are NaN.
  explicit LeaveOut(const Eigen::MatrixXd& hessian);

  const Eigen::MatrixXd& inverse() const { return inverse_; }

  /// `part` is 6 k x 6 k: the rows and columns of P that belong to `scans`, in their order; the rest is zero.
  Eigen::VectorXd solve(const std::vector<size_t>& scans, const Eigen::MatrixXd& part,
                        const Eigen::VectorXd& b) const;

 private:
  Eigen::MatrixXd inverse_;
};

}  // namespace gantry::internal
