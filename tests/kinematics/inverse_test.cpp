#include "gantry/kinematics/inverse.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace gantry {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

/// Linear along x, rotation about z, tilt about y through a point above the table; the sensor looks
/// down at the part at an angle.
Chain three_stages() {
  Chain chain;
  chain.joints.resize(3);
  chain.joints[0].kind = JointKind::kPrismatic;
  chain.joints[0].direction = Eigen::Vector3d::UnitX();
  chain.joints[1].direction = Eigen::Vector3d::UnitZ();
  chain.joints[2].direction = Eigen::Vector3d::UnitY();
  chain.joints[2].point_mm = {0, 0, 60};
  chain.base_from_part_at_zero = pose_from_position_rpy({5, -3, 80}, {0, 0, 0.2});
  chain.base_from_sensor = pose_from_position_rpy({0, -300, 500}, {210 * kDeg, 0, 0});
  return chain;
}

const std::vector<double> kLower{-150, -std::numbers::pi, -40 * kDeg};
const std::vector<double> kUpper{150, std::numbers::pi, 40 * kDeg};

ViewTarget view_of(const Chain& chain, std::span<const double> q) {
  const Pose pose = chain.part_from_sensor(q);
  return {pose.translation(), pose.linear().col(2)};
}

/// The cost that nearest_view promises to minimise.
double cost(const Chain& chain, const ViewTarget& target, std::span<const double> q) {
  const ViewTarget view = view_of(chain, q);
  return (view.sensor_position_mm - target.sensor_position_mm).squaredNorm() +
         1e4 * (view.viewing_direction - target.viewing_direction).squaredNorm();
}

void expect_within_limits(std::span<const double> q) {
  ASSERT_EQ(q.size(), kLower.size());
  for (size_t i = 0; i < q.size(); ++i) {
    EXPECT_GE(q[i], kLower[i]);
    EXPECT_LE(q[i], kUpper[i]);
  }
}

class InverseTest : public ::testing::Test {
 protected:
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  std::vector<double> values() {
    return {uniform(kLower[0], kUpper[0]), uniform(kLower[1], kUpper[1]), uniform(kLower[2], kUpper[2])};
  }

  std::mt19937 random_{8};
  Chain chain_ = three_stages();
};

/// What is reported must be what the joint values give.
void expect_honest(const Chain& chain, const ViewTarget& target, const InverseResult& result) {
  const ViewTarget view = view_of(chain, result.q);
  EXPECT_NEAR(result.position_error_mm, (view.sensor_position_mm - target.sensor_position_mm).norm(), 1e-9);
  const double sine = view.viewing_direction.cross(target.viewing_direction).norm();
  EXPECT_NEAR(result.direction_error_rad,
              std::atan2(sine, view.viewing_direction.dot(target.viewing_direction)), 1e-7);
}

TEST_F(InverseTest, ReachableViewsAreReached) {
  for (int i = 0; i < 50; ++i) {
    const ViewTarget target = view_of(chain_, values());
    const InverseResult result = nearest_view(chain_, target, kLower, kUpper);
    expect_within_limits(result.q);
    expect_honest(chain_, target, result);
    EXPECT_LT(result.position_error_mm, 1e-3);
    EXPECT_LT(result.direction_error_rad, 1e-5);
  }
}

TEST_F(InverseTest, ReachableAtTheLimitsThemselves) {
  for (const auto& q : {kLower, kUpper}) {
    const InverseResult result = nearest_view(chain_, view_of(chain_, q), kLower, kUpper);
    expect_within_limits(result.q);
    EXPECT_LT(result.position_error_mm, 1e-2);
  }
}

TEST_F(InverseTest, UnreachableViewsComeAsNearAsAFineGridCan) {
  constexpr int kSteps = 40;
  for (int trial = 0; trial < 10; ++trial) {
    ViewTarget target = view_of(chain_, values());
    target.sensor_position_mm += Eigen::Vector3d(uniform(-200, 200), uniform(-200, 200), uniform(-200, 200));
    target.viewing_direction =
        rotation_exp({uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)}) * target.viewing_direction;
    const InverseResult result = nearest_view(chain_, target, kLower, kUpper);
    expect_within_limits(result.q);
    expect_honest(chain_, target, result);
    double best = 1e300;
    std::vector<double> q(3);
    for (int i = 0; i < kSteps * kSteps * kSteps; ++i) {
      const std::array steps{i % kSteps, i / kSteps % kSteps, i / kSteps / kSteps};
      for (size_t k = 0; k < 3; ++k) q[k] = kLower[k] + (kUpper[k] - kLower[k]) * steps[k] / (kSteps - 1.0);
      best = std::min(best, cost(chain_, target, q));
    }
    EXPECT_LT(cost(chain_, target, result.q), best * (1 + 1e-9));
  }
}

TEST_F(InverseTest, WhatALinearStageCannotReachIsReported) {
  Chain chain;
  chain.joints.resize(1);
  chain.joints[0].kind = JointKind::kPrismatic;
  chain.joints[0].direction = Eigen::Vector3d::UnitX();
  const std::vector<double> lower{-50}, upper{50};
  // The part moves by q along x, so the sensor stands at -q in the part frame.
  const InverseResult aside = nearest_view(chain, {{-20, 7, 0}, {0, 0, 1}}, lower, upper);
  EXPECT_NEAR(aside.q[0], 20, 1e-5);
  EXPECT_NEAR(aside.position_error_mm, 7, 1e-9);
  const InverseResult beyond = nearest_view(chain, {{-80, 0, 0}, {0, 0, 1}}, lower, upper);
  EXPECT_EQ(beyond.q[0], 50);
  EXPECT_NEAR(beyond.position_error_mm, 30, 1e-9);
  const InverseResult askew =
      nearest_view(chain, {{-20, 0, 0}, {std::sin(0.3), 0, std::cos(0.3)}}, lower, upper);
  EXPECT_NEAR(askew.position_error_mm, 0, 1e-5);
  EXPECT_NEAR(askew.direction_error_rad, 0.3, 1e-9);
}

}  // namespace
}  // namespace gantry
