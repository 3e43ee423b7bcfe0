#include "joint/leave_out.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

namespace gantry::internal {
namespace {

Eigen::MatrixXd random_positive(Eigen::Index size, std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(size, 2 * size, [&] { return normal(random); });
  return a * a.transpose();
}

TEST(LeaveOut, IsTheSolutionWithoutThePart) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 20; ++trial) {
    const std::vector<size_t> scans = {4, 1};
    const Eigen::MatrixXd part = random_positive(12, random);
    Eigen::MatrixXd hessian = random_positive(30, random);
    Eigen::MatrixXd rest = hessian;
    for (Eigen::Index r = 0; r < 12; ++r)
      for (Eigen::Index c = 0; c < 12; ++c) {
        const auto row = static_cast<Eigen::Index>(6 * scans[static_cast<size_t>(r / 6)]) + r % 6,
                   column = static_cast<Eigen::Index>(6 * scans[static_cast<size_t>(c / 6)]) + c % 6;
        hessian(row, column) += part(r, c);
      }
    const Eigen::VectorXd b = Eigen::VectorXd::NullaryExpr(30, [&] { return normal(random); });
    const LeaveOut leave_out(hessian);
    EXPECT_LT((leave_out.solve(scans, part, b) - rest.ldlt().solve(b)).norm(), 1e-8);
    EXPECT_LT((leave_out.inverse() * hessian - Eigen::MatrixXd::Identity(30, 30)).norm(), 1e-8);
  }
}

TEST(LeaveOut, SaysNothingOfWhatIsNotPositiveDefinite) {
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Identity(12, 12);
  hessian(3, 3) = -1;
  const LeaveOut leave_out(hessian);
  EXPECT_FALSE(leave_out.inverse().array().isFinite().any());
  EXPECT_FALSE(leave_out.solve({0}, Eigen::MatrixXd::Zero(6, 6), Eigen::VectorXd::Ones(12)).allFinite());
}

}  // namespace
}  // namespace gantry::internal
