#include "joint/leave_out.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <limits>

namespace gantry::internal {

LeaveOut::LeaveOut(const Eigen::MatrixXd& hessian) {
  const Eigen::LLT<Eigen::MatrixXd> root(hessian);
  if (root.info() == Eigen::Success) {
    inverse_ = root.solve(Eigen::MatrixXd::Identity(hessian.rows(), hessian.cols()));
  } else {
    inverse_.setConstant(hessian.rows(), hessian.cols(), std::numeric_limits<double>::quiet_NaN());
  }
}

Eigen::VectorXd LeaveOut::solve(const std::vector<size_t>& scans, const Eigen::MatrixXd& part,
                                const Eigen::VectorXd& b) const {
  std::vector<Eigen::Index> rows;
  for (const size_t scan : scans)
    for (Eigen::Index k = 0; k < 6; ++k) rows.push_back(static_cast<Eigen::Index>(6 * scan) + k);
  const Eigen::VectorXd with = inverse_ * b;
  const Eigen::MatrixXd columns = inverse_(Eigen::all, rows);
  const Eigen::MatrixXd small =
      Eigen::MatrixXd::Identity(part.rows(), part.cols()) - columns(rows, Eigen::all) * part;
  const Eigen::VectorXd at_scans = small.partialPivLu().solve(with(rows));
  return with + columns * (part * at_scans);
}

}  // namespace gantry::internal
