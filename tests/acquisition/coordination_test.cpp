#include "gantry/acquisition/coordination.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "acquisition/motion_rig.h"

namespace gantry {
namespace {

/// What a trapezoid of these limits takes, from the textbook.
double duration_s(double distance, const MoveCommand& move) {
  const double v = move.speed, a = move.acceleration;
  return distance > v * v / a ? distance / v + v / a : 2 * std::sqrt(distance / a);
}

TEST(Coordination, AllTakeTheSameTimeAndOneOfThemIsAtItsLimit) {
  std::mt19937_64 random(5);
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int k = 0; k < 2000; ++k) {
    std::vector<double> from, to;
    std::vector<AxisLimits> limits;
    for (int i = 0; i < 4; ++i) {
      AxisLimits axis;
      axis.speed = between(0.1, 200);
      axis.acceleration = between(0.1, 2000);
      limits.push_back(axis);
      from.push_back(between(-100, 100));
      to.push_back(k % 7 == i ? from.back() : from.back() + std::pow(10, between(-4, 2)) * (k % 2 ? 1 : -1));
    }
    const CoordinatedMove move = coordinate(from, to, limits);
    double fullest = 0;
    for (size_t i = 0; i < 4; ++i) {
      EXPECT_EQ(move.axes[i].target, to[i]);
      EXPECT_LE(move.axes[i].speed, limits[i].speed * (1 + 1e-12));
      EXPECT_LE(move.axes[i].acceleration, limits[i].acceleration * (1 + 1e-12));
      const double distance = std::abs(to[i] - from[i]);
      if (distance == 0) continue;
      EXPECT_NEAR(duration_s(distance, move.axes[i]), move.duration_s, 1e-9 * move.duration_s);
      fullest = std::max({fullest, move.axes[i].speed / limits[i].speed,
                          move.axes[i].acceleration / limits[i].acceleration});
    }
    EXPECT_NEAR(fullest, 1, 1e-12);
  }
}

TEST(Coordination, NoDistanceIsNoTime) {
  const std::vector<double> q = {1, 2};
  EXPECT_EQ(coordinate(q, q, std::vector<AxisLimits>(2, rig_limits())).duration_s, 0);
}

TEST(Coordination, TheStagesRunAlongAStraightLineInJointSpace) {
  StageDynamics stage = rig_stage();
  stage.following_lag_s = 0;
  MotionRig rig(4, stage);
  rig.home();
  const std::vector<double> to = {280, 35, 150};
  std::vector<double> from;
  for (size_t i = 0; i < 3; ++i) from.push_back(rig.truth(i).true_position);
  const CoordinatedMove move = coordinate(from, to, std::vector<AxisLimits>(3, rig_limits()));
  std::array<MoveCommand, kMaxAxes> moves{};
  std::copy(move.axes.begin(), move.axes.end(), moves.begin());
  const double begin_s = rig.clock.now_s();
  ASSERT_EQ(rig.request(AxisTrigger::kMove, 7, moves), AxisRefusal::kNone);
  for (int cycle = 0; rig.clock.now_s() < begin_s + move.duration_s; ++cycle) {
    rig.step();
    const double s = (rig.truth(0).true_position - from[0]) / (to[0] - from[0]);
    for (size_t i = 1; i < 3; ++i) {
      const double off = rig.truth(i).true_position - (from[i] + s * (to[i] - from[i]));
      EXPECT_LT(std::abs(off), 0.03) << "the residual oscillation, and nothing else, in cycle " << cycle;
    }
  }
  rig.steps(30);
  EXPECT_TRUE(rig.all(AxisState::kStandstill));
}

}  // namespace
}  // namespace gantry
