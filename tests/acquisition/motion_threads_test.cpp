// The real threads: loop, I/O, and a caller that waits. What is asserted is order and outcome, never that
// a busy machine was punctual.

#include "gantry/acquisition/motion_threads.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>

#include "gantry/acquisition/motion.h"
#include "gantry/sim/devices.h"

namespace gantry {
namespace {

TEST(RealTimeLoop, TurnsAtItsPeriodCountsWhatItMissesAndSaysWhatItWasGranted) {
  std::atomic<int> cycles{0};
  SteadyClock clock;
  const double begin_s = clock.now_s();
  RealTimeLoop loop(0.005, 10, [&] {
    if (++cycles == 10) SteadyClock().sleep_s(0.1);  // One cycle takes as long as twenty.
  });
  while (cycles < 40) clock.sleep_s(0.005);
  const double elapsed_s = clock.now_s() - begin_s;
  const LoopStatistics s = loop.statistics();
  EXPECT_GE(s.missed, 19u);
  EXPECT_LE(static_cast<double>(s.cycles + s.missed), elapsed_s / 0.005 + 2) << "never faster than the clock";
  EXPECT_GE(s.busy_max_us, 100'000);
  EXPECT_LE(s.late_p50_us, s.late_p99_us);
  EXPECT_LE(s.late_p99_us, s.late_max_us + 10);
  const RealTimeGrant& grant = loop.grant();
  EXPECT_EQ(grant.note.empty(), grant.fifo && grant.memory_locked) << grant.note;
}

TEST(DurationHistogram, PercentilesAreThoseOfTheDurations) {
  DurationHistogram histogram;
  EXPECT_EQ(histogram.percentile_us(0.5), 0);
  for (int i = 1; i <= 1000; ++i) histogram.record(i);
  EXPECT_NEAR(histogram.percentile_us(0.5), 500, 10);
  EXPECT_NEAR(histogram.percentile_us(0.99), 990, 10);
  EXPECT_EQ(histogram.max_us(), 1000);
  histogram.record(1e6);
  EXPECT_EQ(histogram.percentile_us(1), 1e6) << "beyond the bins the maximum is known";
  histogram.record(-5);
}

/// One stage in this process that outlives the motion.
class ThreadedMotion : public testing::Test {
 protected:
  ThreadedMotion() {
    Chain chain;
    SimulationSettings settings;
    std::vector<AxisSettings> axis_settings;
    for (const char* name : {"x", "y"}) {
      Joint joint;
      joint.name = name;
      joint.kind = JointKind::kPrismatic;
      chain.joints.push_back(joint);
      StageDynamics stage{.travel_min = -5,
                          .travel_max = 105,
                          .max_speed = 400,
                          .max_acceleration = 8000,
                          .homing_speed = 400,
                          .encoder_resolution = 0.001,
                          .settling_time_s = 0.02};
      settings.stages.push_back(stage);
      AxisSettings axis;
      axis.name = name;
      axis.limits = {.lower = 0, .upper = 100, .speed = 300, .acceleration = 6000, .in_position = 0.05};
      axis.limits.jog_speed = 40;
      axis.limits.data_limit_s = 2;
      axis.settle_s = 0.05;
      axis_settings.push_back(axis);
    }
    const TriangleMesh plate = {{{-900, -900, 400}, {900, -900, 400}, {0, 900, 400}}, {{0, 2, 1}}};
    world_ = std::make_unique<SimulatedWorld>(chain, settings, plate, std::nullopt, 1, clock_);
    std::vector<std::unique_ptr<Axis>> axes;
    for (size_t i = 0; i < 2; ++i)
      axes.push_back(std::make_unique<Axis>(make_simulated_drive(axis_settings[i].name, *world_, i),
                                            AxisKind::kLinear, axis_settings[i].limits, clock_));
    MotionOptions options;
    options.threads = true;
    options.supervisor.stall_limit_s = 1;
    options.bus_of_axis = {0, 0};
    motion_ = std::make_unique<Motion>(std::move(axes), axis_settings, options, clock_);
  }

  void home() {
    ASSERT_TRUE(motion_->connect());
    ASSERT_TRUE(motion_->enable());
    const auto homed = motion_->home({{"x", "y"}});
    ASSERT_TRUE(homed) << homed.error().text();
  }
  bool moves() {
    return world_->stage(0).observe(clock_.now_s()).moving || world_->stage(1).observe(clock_.now_s()).moving;
  }

  SteadyClock clock_;
  std::unique_ptr<SimulatedWorld> world_;
  std::unique_ptr<Motion> motion_;
};

TEST_F(ThreadedMotion, HomesMovesAndShowsItsFigures) {
  ASSERT_NO_FATAL_FAILURE(home());
  std::atomic<bool> ending{false};
  std::thread watcher([&] {  // As `status` of another process is served.
    while (!ending) {
      (void)motion_->statuses();
      (void)motion_->loop_statistics();
      clock_.sleep_s(0.002);
    }
  });
  for (const std::vector<double>& q : {std::vector<double>{80, 20}, {10, 90}, {50, 50}}) {
    const auto still = motion_->move_to(q);
    ASSERT_TRUE(still) << still.error().text();
    EXPECT_NEAR(still->q[0], q[0], 0.05);
    EXPECT_NEAR(still->q[1], q[1], 0.05);
    EXPECT_GE(still->duration_s, 0.05);
    EXPECT_GE(still->samples, 2);
  }
  ending = true;
  watcher.join();
  EXPECT_GT(motion_->loop_statistics()->cycles, 10u);
}

TEST_F(ThreadedMotion, AHeldJogStopsWhenItIsLetGo) {
  ASSERT_NO_FATAL_FAILURE(home());
  ASSERT_TRUE(motion_->start_jog(0, 1));
  const double end_s = clock_.now_s() + 0.4;
  while (clock_.now_s() < end_s) {
    motion_->keep_jogging();
    clock_.sleep_s(0.01);
  }
  EXPECT_EQ(motion_->statuses()[0].state, AxisState::kDiscreteMotion);
  while (motion_->statuses()[0].state != AxisState::kStandstill) clock_.sleep_s(0.01);
  EXPECT_TRUE(motion_->figures().dead_man_released);
  EXPECT_LT(world_->stage(0).observe(clock_.now_s()).true_position, 90);
}

TEST_F(ThreadedMotion, StopFromAnotherThreadAndTheEndStopWhatMoves) {
  ASSERT_NO_FATAL_FAILURE(home());
  ASSERT_TRUE(motion_->start_jog(1, 1));
  std::thread stopper([&] { motion_->request_stop(); });
  stopper.join();
  while (motion_->statuses()[1].state != AxisState::kStandstill) clock_.sleep_s(0.01);
  ASSERT_TRUE(motion_->start_jog(1, 1));
  motion_.reset();
  EXPECT_FALSE(moves());
}

TEST_F(ThreadedMotion, AFaultStopsBothAndResetRecovers) {
  ASSERT_NO_FATAL_FAILURE(home());
  std::thread trouble([&] {
    while (!moves()) clock_.sleep_s(0.001);
    clock_.sleep_s(0.05);
    world_->stage(0).set_servo(false, clock_.now_s());
  });
  const auto moved = motion_->move_to(std::vector<double>{90, 90});
  trouble.join();
  ASSERT_FALSE(moved);
  EXPECT_NE(moved.error().device.find("axis x"), std::string::npos) << moved.error().text();
  EXPECT_FALSE(moves());
  ASSERT_TRUE(motion_->reset());
  ASSERT_TRUE(motion_->enable());
  EXPECT_TRUE(motion_->move_to(std::vector<double>{50, 50}));
}

}  // namespace
}  // namespace gantry
