#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <random>

#include "joint/covariance.h"

namespace gantry::internal {
namespace {

constexpr size_t kScans = 5;

/// Patches that move scans at random, each a few scans that see it; and something common to all.
PoseCovariance sample(Eigen::Index patches, double common) {
  constexpr auto kRows = static_cast<Eigen::Index>(6 * kScans);
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  const auto matrix = [&](Eigen::Index rows, Eigen::Index columns) {
    Eigen::MatrixXd m(rows, columns);
    for (auto& value : m.reshaped()) value = normal(random);
    return m;
  };
  Eigen::VectorXd unit(kRows);  // radians are small
  for (Eigen::Index k = 0; k < kRows; ++k) unit[k] = k % 6 < 3 ? 1e-5 : 1e-3;
  PoseCovariance covariance;
  const Eigen::MatrixXd mix = matrix(kRows, kRows);
  covariance.moves = unit.asDiagonal() * mix * matrix(kRows, patches) / std::sqrt(patches);
  covariance.independent = unit.asDiagonal() * mix * mix.transpose() * unit.asDiagonal();
  const Eigen::MatrixXd root = matrix(kRows, 3);
  covariance.common = common * (unit.asDiagonal() * root * root.transpose() * unit.asDiagonal());
  return covariance;
}

Matrix6d block(const Eigen::MatrixXd& all, size_t i, size_t j) {
  return all.block<6, 6>(static_cast<Eigen::Index>(6 * i), static_cast<Eigen::Index>(6 * j));
}

TEST(PoseCovariance, JointHasTheBlocksOfEachScan) {
  for (const Eigen::Index patches : {3, 20, 400}) {
    const PoseCovariance covariance = sample(patches, 0.3);
    const Eigen::MatrixXd joint = covariance.joint();
    ASSERT_EQ(joint.rows(), static_cast<Eigen::Index>(6 * kScans));
    for (size_t i = 0; i < kScans; ++i) {
      EXPECT_EQ(block(joint, 0, i).norm(), 0);
      EXPECT_EQ(block(joint, i, 0).norm(), 0);
      if (i > 0) {
        EXPECT_TRUE(block(joint, i, i).isApprox(covariance.of(i), 1e-6)) << patches;
      }
    }
    EXPECT_TRUE(joint.isApprox(joint.transpose(), 1e-12));
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(joint);
    EXPECT_GT(solver.eigenvalues().minCoeff(), -1e-12 * solver.eigenvalues().maxCoeff());
  }
}

TEST(PoseCovariance, WithManyPatchesJointIsWhatTheyShow) {
  const PoseCovariance covariance = sample(40000, 0);
  const Eigen::MatrixXd joint = covariance.joint();
  for (size_t i = 1; i < kScans; ++i)
    for (size_t j = 1; j < kScans; ++j) {
      const auto rows = [&](size_t k) -> Eigen::MatrixXd {
        return covariance.moves.middleRows<6>(static_cast<Eigen::Index>(6 * k)) -
               covariance.moves.topRows<6>();
      };
      const Matrix6d shown = rows(i) * rows(j).transpose();
      EXPECT_LT((block(joint, i, j) - shown).norm(), 0.02 * covariance.of(i).norm());
    }
}

TEST(PoseCovariance, WhatIsCommonToAllButTheFirstIsFullyCorrelated) {
  // Only the first scan is uncertain: against it all others err alike.
  PoseCovariance covariance = sample(100, 0);
  covariance.moves.setZero();
  covariance.independent.setZero();
  covariance.independent.topLeftCorner<6, 6>() = 1e-6 * Matrix6d::Identity();
  covariance.common = covariance.independent;
  const Eigen::MatrixXd joint = covariance.joint();
  for (size_t i = 1; i < kScans; ++i)
    for (size_t j = 1; j < kScans; ++j)
      EXPECT_TRUE(block(joint, i, j).isApprox(covariance.of(i), 1e-6)) << i << " " << j;
}

}  // namespace
}  // namespace gantry::internal
