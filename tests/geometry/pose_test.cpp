#include "gantry/geometry/pose.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <numbers>
#include <random>

namespace gantry {
namespace {

constexpr double kPi = std::numbers::pi;

class PoseTest : public ::testing::Test {
 protected:
  Eigen::Vector3d direction() { return Eigen::Vector3d(gauss(), gauss(), gauss()).normalized(); }
  Vector6d twist(double angle, double length_mm) {
    Vector6d x;
    x << angle * direction(), length_mm * direction();
    return x;
  }
  Pose pose() { return pose_exp(twist(3.0 * uniform_(random_), 500)); }
  double gauss() { return normal_(random_); }

  std::mt19937 random_{1};
  std::normal_distribution<double> normal_;
  std::uniform_real_distribution<double> uniform_;
};

/// The exponential by its defining power series of the 4x4 twist matrix, scaled and squared.
Eigen::Matrix4d series_exp(const Vector6d& x) {
  constexpr int kSquarings = 10;
  Eigen::Matrix4d m = Eigen::Matrix4d::Zero();
  m.topLeftCorner<3, 3>() = cross_matrix(x.head<3>());
  m.topRightCorner<3, 1>() = x.tail<3>();
  m /= std::pow(2.0, kSquarings);
  Eigen::Matrix4d sum = Eigen::Matrix4d::Identity(), term = sum;
  for (int i = 1; i < 12; ++i) sum += term = term * m / i;
  for (int i = 0; i < kSquarings; ++i) sum = sum * sum;
  return sum;
}

TEST_F(PoseTest, CrossMatrixIsTheCrossProduct) {
  const Eigen::Vector3d a = direction(), b = direction();
  EXPECT_TRUE((cross_matrix(a) * b).isApprox(a.cross(b)));
}

TEST_F(PoseTest, ExpIsTheMatrixExponential) {
  for (const double angle : {0.0, 1e-12, 1e-6, 0.99e-4, 1.01e-4, 1e-2, 1.0, 3.0, kPi, 5.0})
    for (int i = 0; i < 50; ++i) {
      const Vector6d x = twist(angle, 100);
      EXPECT_LT((pose_exp(x).matrix() - series_exp(x)).cwiseAbs().maxCoeff(), 1e-9) << angle;
    }
}

TEST_F(PoseTest, LogUndoesExpFromTinyAnglesToNearlyPi) {
  for (const double angle :
       {0.0, 1e-14, 1e-9, 1e-6, 0.99e-4, 1.01e-4, 1e-3, 0.5, 2.0, 3.0, kPi - 1e-3, kPi - 1e-6})
    for (int i = 0; i < 100; ++i) {
      const Vector6d x = twist(angle, 300), y = pose_log(pose_exp(x));
      EXPECT_LT((y - x).head<3>().norm(), 1e-12 + 1e-13 * angle) << angle;
      EXPECT_LT((y - x).tail<3>().norm(), 1e-8) << angle;
    }
}

TEST_F(PoseTest, ExpUndoesLogAtPiItself) {
  // There the axis may come back reversed; the pose may not.
  for (int i = 0; i < 100; ++i) {
    const Pose p = pose_exp(twist(kPi, 300));
    EXPECT_NEAR(pose_log(p).head<3>().norm(), kPi, 1e-12);
    EXPECT_LT((pose_exp(pose_log(p)).matrix() - p.matrix()).cwiseAbs().maxCoeff(), 1e-9);
  }
}

TEST_F(PoseTest, AdjointMovesATwistToTheOtherSide) {
  for (int i = 0; i < 200; ++i) {
    const Pose p = pose();
    const Vector6d x = twist(1.5, 50);
    EXPECT_LT(((p * pose_exp(x)).matrix() - (pose_exp(adjoint(p) * x) * p).matrix()).cwiseAbs().maxCoeff(),
              1e-9);
  }
}

TEST_F(PoseTest, AdjointIsAHomomorphism) {
  const Pose a = pose(), b = pose();
  EXPECT_TRUE(adjoint(a * b).isApprox(adjoint(a) * adjoint(b), 1e-12));
  EXPECT_TRUE((adjoint(a) * adjoint(a.inverse())).isApprox(Matrix6d::Identity(), 1e-9));
}

TEST_F(PoseTest, RollPitchYawTurnAboutTheFixedAxesInThatOrder) {
  const Pose p = pose_from_position_rpy({1, 2, 3}, {0.2, -0.3, 0.4});
  EXPECT_TRUE(p.linear().isApprox(rotation_exp({0, 0, 0.4}) * rotation_exp({0, -0.3, 0}) *
                                  rotation_exp({0.2, 0, 0})));
  EXPECT_EQ(p.translation(), Eigen::Vector3d(1, 2, 3));
  // Roll alone lifts y towards z.
  EXPECT_TRUE((pose_from_position_rpy({0, 0, 0}, {kPi / 2, 0, 0}) * Eigen::Vector3d::UnitY())
                  .isApprox(Eigen::Vector3d::UnitZ(), 1e-12));
}

TEST_F(PoseTest, DistancesBetweenPoses) {
  const Pose a = pose(), moved = a * pose_from_position_rpy({3, 0, 4}, {0, 0.7, 0});
  EXPECT_NEAR(rotation_distance(a, moved), 0.7, 1e-12);
  EXPECT_NEAR(rotation_distance(moved, a), 0.7, 1e-12);
  EXPECT_NEAR(translation_distance(a, moved), 5.0, 1e-10);
}

TEST_F(PoseTest, PointSigmaAgreesWithMonteCarlo) {
  constexpr int kSamples = 20'000;
  for (int trial = 0; trial < 5; ++trial) {
    Matrix6d root = Matrix6d::NullaryExpr([&] { return gauss(); });
    root.topRows<3>() *= 1e-4;
    root.bottomRows<3>() *= 1e-2;
    const Eigen::Vector3d point = 200 * direction();
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (int i = 0; i < kSamples; ++i) {
      const Vector6d drawn = Vector6d::NullaryExpr([&] { return gauss(); });
      const Vector6d error = root * drawn;
      const Eigen::Vector3d moved = pose_exp(error) * point - point;
      scatter += moved * moved.transpose() / kSamples;
    }
    const double expected =
        std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues()(2));
    EXPECT_NEAR(point_sigma_mm(root * root.transpose(), point) / expected, 1.0, 0.03);
  }
}

TEST_F(PoseTest, CovarianceIsTheSumOfItsParts) {
  UncertainPose p;
  EXPECT_EQ(p.covariance(), Matrix6d::Zero());
  p.independent.setConstant(2);
  EXPECT_EQ(p.shared(), Matrix6d::Zero()) << "nothing is shared unless it is said";
  EXPECT_EQ(p.covariance(), Matrix6d::Constant(2));
  p.shared_factor.setConstant(6, 3, 2);
  EXPECT_EQ(p.shared(), Matrix6d::Constant(12));
  EXPECT_EQ(p.covariance(), Matrix6d::Constant(14));
  EXPECT_EQ(point_sigma_mm(Matrix6d::Zero(), {1, 2, 3}), 0.0);
}

}  // namespace
}  // namespace gantry
