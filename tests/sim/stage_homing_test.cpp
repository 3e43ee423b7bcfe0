#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "gantry/sim/stage.h"

namespace gantry {
namespace {

StageDynamics with_switch(HomingMethod method, int direction) {
  StageDynamics d;
  d.travel_min = -20;
  d.travel_max = 320;
  d.max_speed = 200;
  d.max_acceleration = 1000;
  d.homing_speed = 80;
  d.creep_speed = 4;
  d.homing = method;
  d.search_direction = direction;
  d.back_off = 3;
  d.index_pitch = 5;
  d.lower_limit = -15;
  d.upper_limit = 315;
  if (direction > 0) {
    d.travel_min = -320;
    d.travel_max = 20;
    d.lower_limit = -315;
    d.upper_limit = 15;
  }
  return d;
}

struct Sample {
  double t_s, x, v;
  StageState state;
};

/// Homes and records the truth every millisecond until homed or at rest without it.
std::vector<Sample> record_homing(SimulatedStage& stage, double now_s) {
  std::vector<Sample> samples;
  stage.set_servo(true, now_s);
  EXPECT_TRUE(stage.start_homing(now_s));
  for (int i = 0; i < 60000; ++i) {
    const double t = now_s + 1e-3 * i;
    const StageState s = stage.observe(t);
    samples.push_back({t, s.true_position, s.velocity, s});
    if (i > 0 && !s.moving) break;
  }
  return samples;
}

class SwitchHoming : public testing::TestWithParam<std::tuple<HomingMethod, int>> {};

TEST_P(SwitchHoming, SearchesFastApproachesSlowlyAndFindsZeroFromAnywhere) {
  const auto [method, direction] = GetParam();
  const StageDynamics d = with_switch(method, direction);
  for (uint64_t seed = 0; seed < 12; ++seed) {
    SimulatedStage stage(d, seed);
    const StageState before = stage.observe(0);
    const auto samples = record_homing(stage, 0);
    const StageState after = samples.back().state;
    EXPECT_TRUE(after.homed);
    EXPECT_NEAR(after.true_position, 0, 1e-9);
    EXPECT_NEAR(after.encoder_position, 0, 1e-9);
    EXPECT_EQ(after.homing_failure, HomingFailure::kNone);
    double fastest = 0, last_approach = 0;
    bool switch_seen = before.home_switch;
    for (size_t i = 1; i < samples.size(); ++i) {
      fastest = std::max(fastest, std::abs(samples[i].v));
      switch_seen = switch_seen || samples[i].state.home_switch;
      EXPECT_LE(std::abs(samples[i].x - samples[i - 1].x), 0.08 + 1e-9) << "no jump";
      if (std::abs(samples[i].x) < 1 && i + 300 > samples.size())
        last_approach = std::max(last_approach, std::abs(samples[i].v));
    }
    EXPECT_TRUE(switch_seen) << "zero without the switch would be a guess";
    EXPECT_LE(last_approach, 4 + 1e-9) << "creep speed";
    if (!before.home_switch && std::abs(before.true_position) > 20) {
      EXPECT_NEAR(fastest, 80, 1);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, SwitchHoming,
                         testing::Combine(testing::Values(HomingMethod::kSwitch,
                                                          HomingMethod::kSwitchAndIndex),
                                          testing::Values(-1, 1)));

TEST(StageHoming, ADeadSwitchEndsAtTheLimitSwitchOrAtTheHardStop) {
  for (const bool has_limits : {true, false}) {
    StageDynamics d = with_switch(HomingMethod::kSwitch, -1);
    if (!has_limits) d.lower_limit.reset();
    SimulatedStage stage(d, 2);
    stage.inject(StageFault::kDeadHomeSwitch, 0);
    const auto samples = record_homing(stage, 0);
    EXPECT_FALSE(samples.back().state.homed);
    EXPECT_EQ(samples.back().state.homing_failure,
              has_limits ? HomingFailure::kLimitSwitch : HomingFailure::kSwitchNotFound);
    EXPECT_EQ(samples.back().state.lower_limit, has_limits);
    EXPECT_GE(samples.back().x, has_limits ? -15 - 80.0 * 80 / 2000 - 1e-9 : -20 - 1e-9);
    stage.clear(StageFault::kDeadHomeSwitch, 100);
    EXPECT_TRUE(record_homing(stage, 100).back().state.homed) << "mended";
  }
}

TEST(StageHoming, HomingFindsTheTruthAgainAfterASlip) {
  SimulatedStage stage(with_switch(HomingMethod::kSwitch, -1), 3);
  record_homing(stage, 0);
  stage.start_move(100, 200, 1000, 100);
  stage.slip(-2.5, 101);
  const StageState slipped = stage.observe(110);
  EXPECT_NEAR(slipped.encoder_position, 100, 1e-9);
  EXPECT_NEAR(slipped.true_position, 97.5, 1e-9);
  EXPECT_TRUE(slipped.homed) << "nobody has noticed";
  record_homing(stage, 120);
  stage.start_move(100, 200, 1000, 200);
  EXPECT_NEAR(stage.observe(210).true_position, 100, 1e-9);
}

StageState at_100(SimulatedStage& stage) {
  record_homing(stage, 0);
  stage.start_move(100, 200, 1000, 100);
  return stage.observe(110);
}

TEST(StageLimits, AMoveOntoALimitSwitchStopsWithinTheBrakingDistance) {
  SimulatedStage stage(with_switch(HomingMethod::kSwitch, -1), 3);
  at_100(stage);
  stage.start_move(319, 200, 500, 200);
  bool closed_in_motion = false;
  for (int i = 0; i < 5000; ++i) {
    const StageState s = stage.observe(200 + 1e-3 * i);
    closed_in_motion = closed_in_motion || (s.upper_limit && s.moving);
    EXPECT_EQ(s.upper_limit, s.true_position >= 315) << s.true_position;
  }
  const StageState rest = stage.observe(210);
  EXPECT_TRUE(closed_in_motion);
  EXPECT_TRUE(rest.upper_limit && rest.stopped_by_limit);
  EXPECT_FALSE(rest.in_position);
  EXPECT_GT(rest.true_position, 315);
  EXPECT_LE(rest.true_position, 320);
  stage.start_move(319.9, 200, 500, 220);
  EXPECT_NEAR(stage.observe(230).true_position, rest.true_position, 1e-9) << "no step further out";
  stage.start_move(300, 200, 500, 240);
  EXPECT_NEAR(stage.observe(250).true_position, 300, 1e-9) << "the way back is free";
}

TEST(StageLimits, BouncingReadingsAreRandomNearTheSwitchOnlyAndRepeatable) {
  const auto readings = [](uint64_t seed) {
    SimulatedStage stage(with_switch(HomingMethod::kSwitch, -1), seed);
    at_100(stage);
    stage.inject(StageFault::kLimitBounce, 120);
    EXPECT_FALSE(stage.observe(121).upper_limit);
    stage.start_move(314.5, 200, 1000, 200);
    std::vector<bool> out;
    for (int i = 0; i < 400; ++i) out.push_back(stage.observe(210 + 1e-3 * i).upper_limit);
    stage.clear(StageFault::kLimitBounce, 220);
    EXPECT_FALSE(stage.observe(221).upper_limit);
    return out;
  };
  const auto a = readings(3);
  EXPECT_EQ(a, readings(3));
  EXPECT_NE(a, readings(4));
  const auto closed = std::count(a.begin(), a.end(), true);
  EXPECT_GT(closed, 120);
  EXPECT_LT(closed, 280);
}

TEST(StageFollowing, LagIsProportionalToTheSpeedAndGoneAtRest) {
  StageDynamics d = with_switch(HomingMethod::kSwitch, -1);
  d.following_lag_s = 0.004;
  SimulatedStage stage(d, 3);
  at_100(stage);
  for (const double speed : {20.0, 100.0, 200.0}) {
    stage.start_move(300, speed, 1000, 300);
    const StageState cruising = stage.observe(300 + speed / 1000 + 0.1);
    EXPECT_NEAR(cruising.following_error, 0.004 * speed, 1e-9);
    EXPECT_NEAR(cruising.velocity, speed, 1e-9);
    const StageState rest = stage.observe(350);
    EXPECT_EQ(rest.following_error, 0);
    EXPECT_TRUE(rest.in_position);
    stage.start_move(100, 200, 1000, 360);
    stage.observe(400);
    stage.start_move(100, 200, 1000, 290);
  }
}

TEST(StageFaults, AStuckCarriageStaysBehindAndFollowsWhenItIsLetGo) {
  SimulatedStage stage(with_switch(HomingMethod::kSwitch, -1), 3);
  at_100(stage);
  stage.start_move(300, 100, 1000, 200);
  const double here = stage.observe(201).true_position;
  stage.inject(StageFault::kStuck, 201);
  const StageState stuck = stage.observe(202);
  EXPECT_NEAR(stuck.true_position, here, 1e-9);
  EXPECT_NEAR(stuck.following_error, 100, 1);
  const StageState ended = stage.observe(210);
  EXPECT_FALSE(ended.in_position) << "the command has ended, the carriage has not arrived";
  stage.clear(StageFault::kStuck, 211);
  EXPECT_NEAR(stage.observe(211).true_position, here, 1e-6) << "no jump";
  EXPECT_NEAR(stage.observe(220).true_position, 300, 1e-9);
}

TEST(StageFaults, AStuckCarriageWithoutPowerStaysAndPowerBringsNoJump) {
  SimulatedStage stage(with_switch(HomingMethod::kSwitch, -1), 3);
  at_100(stage);
  stage.start_move(300, 100, 1000, 200);
  stage.inject(StageFault::kStuck, 201);
  const double here = stage.observe(203).true_position;
  stage.set_servo(false, 204);
  stage.set_servo(true, 205);
  stage.clear(StageFault::kStuck, 206);
  EXPECT_NEAR(stage.observe(210).true_position, here, 1e-9);
  EXPECT_NEAR(stage.observe(210).following_error, 0, 1e-9);
}

TEST(StageFaults, ARunawayHeedsOnlyTheLossOfPower) {
  for (const StageFault fault : {StageFault::kRunawayUp, StageFault::kRunawayDown}) {
    SimulatedStage stage(with_switch(HomingMethod::kSwitch, -1), 3);
    at_100(stage);
    const double way = fault == StageFault::kRunawayUp ? 1 : -1;
    stage.inject(fault, 200);
    stage.halt(200.1);
    stage.start_move(100, 200, 1000, 200.2);
    const StageState running = stage.observe(200.4);
    EXPECT_GT(way * (running.true_position - 100), 20);
    EXPECT_GT(way * running.velocity, 100);
    EXPECT_TRUE(running.moving);
    stage.set_servo(false, 200.4);
    EXPECT_NEAR(stage.observe(201).true_position, running.true_position, 1e-6);
    stage.set_servo(true, 202);
    EXPECT_GT(way * (stage.observe(202.3).true_position - running.true_position), 10)
        << "the fault is still there";
    stage.clear(fault, 202.3);
    const double rest = stage.observe(205).true_position;
    EXPECT_EQ(stage.observe(206).true_position, rest);
    stage.start_move(100, 200, 1000, 210);
    EXPECT_NEAR(stage.observe(220).true_position, 100, 1e-9) << "repaired";
  }
}

TEST(StageBacklash, TheCarriageLagsByThePlayAccordingToTheSideItCameFrom) {
  StageDynamics d = with_switch(HomingMethod::kSwitch, -1);
  d.backlash = 0.2;
  SimulatedStage stage(d, 3);
  at_100(stage);
  double now_s = 200;
  const auto at = [&](double target) {
    stage.start_move(target, 200, 1000, now_s);
    now_s += 20;
    return stage.observe(now_s).true_position - stage.observe(now_s).encoder_position;
  };
  at(50);
  EXPECT_NEAR(at(150), -0.1, 1e-9) << "from below";
  EXPECT_NEAR(at(120), 0.1, 1e-9) << "from above";
  EXPECT_NEAR(at(120.05), 0.05, 1e-9) << "within the play the carriage stays";
  EXPECT_NEAR(at(150), -0.1, 1e-9);
}

TEST(StageWatchdog, ItHaltsByItselfWhenNobodyKeepsItAlive) {
  SimulatedStage stage(with_switch(HomingMethod::kSwitch, -1), 3);
  at_100(stage);
  stage.start_move(300, 100, 1000, 200);
  stage.halt_unless_kept_alive(200.5, 200);
  stage.halt_unless_kept_alive(200.8, 200.3);
  EXPECT_GT(stage.observe(200.79).velocity, 99);
  const StageState rest = stage.observe(202);
  EXPECT_FALSE(rest.moving);
  EXPECT_FALSE(rest.in_position);
  EXPECT_NEAR(rest.true_position, 100 + 0.8 * 100 - 5 + 5, 1e-6) << "50 ms of ramp up, and 5 mm to brake";
}

}  // namespace
}  // namespace gantry
