#include "gantry/sim/stage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace gantry {
namespace {

StageDynamics ideal_stage() {
  return {.travel_min = -10,
          .travel_max = 310,
          .max_speed = 200,
          .max_acceleration = 1000,
          .homing_speed = 80,
          .encoder_resolution = 0,
          .repeatability_sigma = 0};
}

/// Powered and homed, at rest at 0; `now_s` is then the present time.
void home(SimulatedStage& stage, double& now_s) {
  stage.set_servo(true, now_s);
  ASSERT_TRUE(stage.start_homing(now_s));
  now_s += 20;
  ASSERT_TRUE(stage.observe(now_s).homed);
}

struct MoveCase {
  double target, speed, acceleration;
};

class StageMove : public testing::TestWithParam<MoveCase> {};

/// What a trapezoid of these limits takes, from the textbook.
double trapezoid_s(double distance, double speed, double acceleration) {
  const double full_speed_distance = distance - speed * speed / acceleration;
  return full_speed_distance > 0 ? 2 * speed / acceleration + full_speed_distance / speed
                                 : 2 * std::sqrt(distance / acceleration);
}

TEST_P(StageMove, KeepsSpeedAndAccelerationAndEndsWhenTheTrapezoidDoes) {
  SimulatedStage stage(ideal_stage(), 1);
  double start_s = 0;
  home(stage, start_s);
  const auto [target, commanded_speed, commanded_acceleration] = GetParam();
  const double speed = std::min(commanded_speed, 200.0),
               acceleration = std::min(commanded_acceleration, 1000.0);
  const double duration_s = trapezoid_s(std::abs(target), speed, acceleration);
  ASSERT_TRUE(stage.start_move(target, commanded_speed, commanded_acceleration, start_s));

  // The ramp only; what follows it is the settling.
  const double step_s = duration_s / 500;
  std::vector<double> x;
  for (int i = 0; i <= 500; ++i) {
    const StageState state = stage.observe(start_s + i * step_s * (1 - 1e-12));
    x.push_back(state.true_position);
    EXPECT_TRUE(state.moving);
    EXPECT_FALSE(state.in_position);
  }
  const double way = target < 0 ? -1 : 1;
  for (size_t i = 1; i < x.size(); ++i) {
    const double v = way * (x[i] - x[i - 1]) / step_s;
    EXPECT_GE(v, 0) << "backwards at sample " << i;
    EXPECT_LE(v, speed * (1 + 1e-9));
    if (i + 1 == x.size()) break;
    EXPECT_LE(std::abs(x[i + 1] - 2 * x[i] + x[i - 1]) / (step_s * step_s), acceleration * (1 + 1e-6));
  }
  EXPECT_NEAR(x.back(), target, 1e-9);
  EXPECT_LT(std::abs(x[x.size() - 3]), std::abs(target)) << "arrived too early";

  const double settled_s = start_s + duration_s + ideal_stage().settling_time_s;
  EXPECT_TRUE(stage.observe(settled_s - 1e-6).moving);
  const StageState rest = stage.observe(settled_s + 1e-6);
  EXPECT_FALSE(rest.moving);
  EXPECT_TRUE(rest.in_position);
  EXPECT_NEAR(rest.true_position, target, 1e-9);
  EXPECT_EQ(rest.velocity, 0);
}

INSTANTIATE_TEST_SUITE_P(Ramps, StageMove,
                         testing::Values(MoveCase{250, 120, 600}, MoveCase{250, 1e6, 1e6},
                                         MoveCase{3, 120, 600}, MoveCase{-8, 20, 100},
                                         MoveCase{-0.01, 120, 600}, MoveCase{24, 120, 600}));

TEST(Stage, SettlingIsADampedOscillationAroundTheTarget) {
  SimulatedStage stage(ideal_stage(), 1);
  double now_s = 0;
  home(stage, now_s);
  stage.start_move(100, 120, 600, now_s);
  const double end_s = now_s + trapezoid_s(100, 120, 600);
  double first = 0, last = 0;
  for (double t = 0; t < 0.15; t += 0.001) {
    const double error = std::abs(stage.observe(end_s + t).true_position - 100);
    (t < 0.075 ? first : last) = std::max(t < 0.075 ? first : last, error);
  }
  EXPECT_GT(first, 0.005) << "there is something to wait for";
  EXPECT_LT(first, 0.05);
  EXPECT_LT(last, 0.1 * first);
}

TEST(Stage, HaltEndsWithinTheStoppingDistance) {
  SimulatedStage stage(ideal_stage(), 1);
  double now_s = 0;
  home(stage, now_s);
  for (const double halt_after_s : {0.05, 0.3, 1.0, 2.0, 2.15}) {
    stage.start_move(0, 200, 1000, now_s);
    now_s += 10;
    stage.start_move(250, 120, 600, now_s);
    const double halt_s = now_s + halt_after_s;
    const StageState before = stage.observe(halt_s);
    ASSERT_GT(before.velocity, 0);
    stage.halt(halt_s);
    const double stopping_mm = before.velocity * before.velocity / (2 * 1000);
    const double stopping_s = before.velocity / 1000;
    double previous = before.true_position;
    for (int i = 1; i <= 200; ++i) {
      const double x = stage.observe(halt_s + stopping_s * i / 200 * (1 - 1e-12)).true_position;
      EXPECT_GE(x, previous - 1e-12);
      EXPECT_LE(x - previous, before.velocity * stopping_s / 200 + 1e-9);
      previous = x;
    }
    now_s = halt_s + 10;
    const StageState rest = stage.observe(now_s);
    EXPECT_NEAR(rest.true_position, before.true_position + stopping_mm, 1e-9);
    EXPECT_FALSE(rest.moving);
    EXPECT_FALSE(rest.in_position) << "the move did not end at its target";
  }
}

TEST(Stage, HomingFindsTheHomePositionThatIsUnknownAtPowerOn) {
  int far_off = 0;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    SimulatedStage stage(ideal_stage(), seed);
    const StageState start = stage.observe(0);
    EXPECT_FALSE(start.homed || start.servo_on || start.moving || start.in_position);
    EXPECT_GE(start.true_position, -10);
    EXPECT_LE(start.true_position, 310);
    const double offset = start.encoder_position - start.true_position;
    far_off += std::abs(offset) > 5;

    EXPECT_FALSE(stage.start_homing(0)) << "without power";
    stage.set_servo(true, 0);
    ASSERT_TRUE(stage.start_homing(0));
    const double end_s = trapezoid_s(std::abs(start.true_position), 80, 1000) + ideal_stage().settling_time_s;
    const StageState during = stage.observe(end_s - 1e-6);
    EXPECT_FALSE(during.homed);
    EXPECT_TRUE(during.moving);
    EXPECT_NEAR(during.encoder_position - during.true_position, offset, 1e-9);
    const StageState after = stage.observe(end_s + 1e-6);
    EXPECT_TRUE(after.homed);
    EXPECT_FALSE(after.moving);
    EXPECT_FALSE(after.in_position) << "homing is not a move";
    EXPECT_NEAR(after.true_position, 0, 1e-9);
    EXPECT_NEAR(after.encoder_position, 0, 1e-9);
    stage.set_servo(false, end_s + 1);
    EXPECT_TRUE(stage.observe(end_s + 2).homed) << "an encoder without power still counts";
  }
  EXPECT_GT(far_off, 10);
}

TEST(Stage, InterruptedHomingDoesNotCount) {
  for (const bool by_servo : {false, true}) {
    SimulatedStage stage(ideal_stage(), 4);
    stage.set_servo(true, 0);
    ASSERT_TRUE(stage.start_homing(0));
    if (by_servo)
      stage.set_servo(false, 0.2);
    else
      stage.halt(0.2);
    EXPECT_FALSE(stage.observe(100).homed);
  }
}

TEST(Stage, WithoutPowerItStopsAndObeysNothing) {
  SimulatedStage stage(ideal_stage(), 1);
  double now_s = 0;
  home(stage, now_s);
  stage.start_move(250, 120, 600, now_s);
  now_s += 1;
  const double here = stage.observe(now_s).true_position;
  stage.set_servo(false, now_s);
  EXPECT_FALSE(stage.start_move(0, 120, 600, now_s));
  for (const double t : {0.0, 0.1, 10.0}) {
    const StageState state = stage.observe(now_s + t);
    EXPECT_NEAR(state.true_position, here, 1e-9);
    EXPECT_FALSE(state.moving || state.servo_on || state.in_position);
  }
  stage.set_servo(true, now_s + 10);
  EXPECT_NEAR(stage.observe(now_s + 20).true_position, here, 1e-9) << "power does not revive the move";
}

TEST(Stage, HardStopsClipTheTravel) {
  SimulatedStage stage(ideal_stage(), 1);
  double now_s = 0;
  home(stage, now_s);
  for (const auto& [target, stop] : {std::pair{1000.0, 310.0}, std::pair{-1000.0, -10.0}}) {
    stage.start_move(target, 120, 600, now_s);
    for (int i = 0; i < 100; ++i) {
      EXPECT_LE(stage.observe(now_s + 0.1 * i).true_position, 310.05);
      EXPECT_GE(stage.observe(now_s + 0.1 * i).true_position, -10.05);
    }
    now_s += 20;
    EXPECT_NEAR(stage.observe(now_s).true_position, stop, 1e-9);
  }
}

TEST(Stage, RepeatabilityHasTheStatedSigmaAndIsDrawnPerMove) {
  constexpr double kSigma = 0.005;
  constexpr int kMoves = 2000;
  StageDynamics dynamics = ideal_stage();
  dynamics.repeatability_sigma = kSigma;
  SimulatedStage stage(dynamics, 7);
  double now_s = 0;
  home(stage, now_s);
  double sum = 0, sum2 = 0, sum_lag = 0, previous = 0;
  for (int i = 0; i < kMoves; ++i) {
    stage.start_move(i % 2 ? 50 : 52, 120, 600, now_s);
    now_s += 5;
    const StageState rest = stage.observe(now_s);
    const double error = rest.true_position - rest.encoder_position;
    EXPECT_EQ(error, stage.observe(now_s + 100).true_position - rest.encoder_position) << "drawn once a move";
    sum += error;
    sum2 += error * error;
    sum_lag += error * previous;
    previous = error;
  }
  // Four standard deviations of each estimate.
  EXPECT_NEAR(sum / kMoves, 0, 4 * kSigma / std::sqrt(kMoves));
  EXPECT_NEAR(std::sqrt(sum2 / kMoves), kSigma, 4 * kSigma / std::sqrt(2 * kMoves));
  EXPECT_NEAR(sum_lag / sum2, 0, 4 / std::sqrt(kMoves)) << "moves are independent";
}

TEST(Stage, TheEncoderReportsMultiplesOfItsResolution) {
  StageDynamics dynamics = ideal_stage();
  dynamics.encoder_resolution = 0.01;
  SimulatedStage stage(dynamics, 1);
  double now_s = 0;
  home(stage, now_s);
  stage.start_move(123.456, 120, 600, now_s);
  for (int i = 0; i < 300; ++i) {
    const StageState state = stage.observe(now_s + 0.01 * i);
    const double counts = state.encoder_position / 0.01;
    EXPECT_NEAR(counts, std::round(counts), 1e-6);
    EXPECT_LE(std::abs(state.encoder_position - state.true_position), 0.005 + 1e-9);
  }
}

TEST(Stage, TheSeedDecidesEverything) {
  StageDynamics dynamics = ideal_stage();
  dynamics.repeatability_sigma = 0.005;
  const auto history = [&](uint64_t seed) {
    SimulatedStage stage(dynamics, seed);
    std::vector<double> out = {stage.observe(0).true_position, stage.observe(0).encoder_position};
    double now_s = 0;
    home(stage, now_s);
    for (const double target : {10.0, 200.0, 30.0}) {
      stage.start_move(target, 120, 600, now_s);
      out.push_back(stage.observe(now_s + 0.3).true_position);
      now_s += 10;
      out.push_back(stage.observe(now_s).true_position);
    }
    return out;
  };
  EXPECT_EQ(history(5), history(5));
  const auto a = history(5), b = history(6);
  for (size_t i = 0; i < a.size(); ++i) EXPECT_NE(a[i], b[i]) << i;
}

}  // namespace
}  // namespace gantry
