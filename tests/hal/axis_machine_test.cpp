// The watchdogs and the rules of motion of AxisMachine, each on the readings that should wake it and on
// those that must not.

#include "gantry/hal/axis_machine.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "hal/fake_drive.h"

namespace gantry {
namespace {

using enum AxisState;

AxisLimits watched() {
  AxisLimits limits = kFakeLimits;
  limits.following_error = 1.0;
  limits.following_error_at_rest = 0.2;
  limits.following_error_time_s = 0.05;
  limits.jog_speed = 2;
  limits.unhomed_jog_speed = 0.5;
  limits.data_limit_s = 0.3;
  return limits;
}

class AxisMachineTest : public testing::Test {
 protected:
  AxisMachineTest() { drive.clock = &clock; }

  void step(double duration_s = 0.01) {
    clock.sleep_s(duration_s);
    channel.service();
    machine.step(channel.latest(), clock.now_s());
  }
  void settle() {
    for (int i = 0; i < 3; ++i) step();
  }
  void stand(bool homed = true) {
    drive.status.homed = homed;
    step();
    ASSERT_EQ(machine.enable(clock.now_s()), AxisRefusal::kNone);
    step();
    ASSERT_EQ(machine.state(), kStandstill);
    drive.calls.clear();
  }
  void run_to(double target) {
    ASSERT_EQ(machine.move({target, 10, 100}, clock.now_s()), AxisRefusal::kNone);
    drive.status.moving = true;
    step();
    ASSERT_EQ(machine.state(), kDiscreteMotion);
    drive.calls.clear();
  }
  void expect_error(AxisReason reason, const char* last_call = "halt") {
    EXPECT_EQ(machine.state(), kErrorStop);
    EXPECT_EQ(machine.error().reason, reason) << describe(machine.error(), AxisKind::kLinear);
    channel.service();
    ASSERT_FALSE(drive.calls.empty());
    EXPECT_EQ(drive.calls.back(), last_call);
  }
  bool called(const char* call) const { return std::count(drive.calls.begin(), drive.calls.end(), call) > 0; }

  VirtualClock clock;
  FakeDrive drive;
  DriveChannel channel{drive, clock};
  AxisMachine machine{AxisKind::kLinear, watched(), channel};
};

TEST_F(AxisMachineTest, FollowingErrorMayGrowWithTheSpeedAndMayExceedForAMoment) {
  stand();
  run_to(80);
  // At full speed (10 mm/s) 1 mm is allowed.
  for (int i = 0; i < 30; ++i) {
    drive.status.position += 0.1;
    drive.status.following_error = 0.95;
    step();
    ASSERT_EQ(machine.state(), kDiscreteMotion) << i;
  }
  drive.status.following_error = 1.5;  // A single reading.
  drive.status.position += 0.1;
  step();
  drive.status.following_error = 0.5;
  drive.status.position += 0.1;
  step();
  ASSERT_EQ(machine.state(), kDiscreteMotion);
  // The axis sticks: at rest 0.2 mm is the limit.
  drive.status.following_error = -0.25;
  int steps = 0;
  while (machine.state() == kDiscreteMotion && steps < 100) {
    step();
    ++steps;
  }
  EXPECT_GE(steps, 5);
  EXPECT_LE(steps, 8) << "50 ms, at 10 ms a step";
  expect_error(AxisReason::kFollowingError);
  EXPECT_EQ(machine.error().value, -0.25);
}

TEST_F(AxisMachineTest, FollowingErrorIsWatchedAtStandstillAndNotWhereTheDriveTellsNone) {
  stand();
  for (int i = 0; i < 20; ++i) step();
  EXPECT_EQ(machine.state(), kStandstill);
  drive.status.following_error = 0.3;
  for (int i = 0; i < 10; ++i) step();
  expect_error(AxisReason::kFollowingError);
}

TEST_F(AxisMachineTest, ALimitSwitchStopsAMoveAndThenOnlyTheWayBackIsFree) {
  stand();
  run_to(80);
  drive.status.position = 60;
  drive.status.upper_limit = true;
  step();
  expect_error(AxisReason::kLimitSwitch);
  EXPECT_EQ(machine.error().code, 1);

  drive.status.moving = false;
  ASSERT_EQ(machine.reset(clock.now_s()), AxisRefusal::kNone);
  settle();
  ASSERT_EQ(machine.state(), kDisabled);
  ASSERT_EQ(machine.enable(clock.now_s()), AxisRefusal::kNone);
  settle();
  ASSERT_EQ(machine.state(), kStandstill) << "a switch that was known is no news";
  EXPECT_EQ(machine.move({61, 10, 100}, clock.now_s()), AxisRefusal::kOnLimitSwitch);
  EXPECT_EQ(machine.jog({61, 1, 100}, clock.now_s()), AxisRefusal::kOnLimitSwitch);
  EXPECT_EQ(machine.move({20, 10, 100}, clock.now_s()), AxisRefusal::kNone);
}

TEST_F(AxisMachineTest, HomingMayRunOverALimitSwitch) {
  stand(false);
  ASSERT_EQ(machine.home(clock.now_s()), AxisRefusal::kNone);
  drive.status.moving = true;
  drive.status.lower_limit = true;
  step();
  EXPECT_EQ(machine.state(), kHoming);
}

TEST_F(AxisMachineTest, HomingThatTheDriveGaveUpIsAFaultAfterAMoment) {
  stand(false);
  ASSERT_EQ(machine.home(clock.now_s()), AxisRefusal::kNone);
  for (int i = 0; i < 40; ++i) step();  // A drive may need a moment until its motion shows.
  EXPECT_EQ(machine.state(), kHoming);
  drive.status.moving = true;
  for (int i = 0; i < 100; ++i) step();
  EXPECT_EQ(machine.state(), kHoming);
  drive.status.moving = false;
  for (int i = 0; i < 55; ++i) step();
  expect_error(AxisReason::kHomingFailed);
}

TEST_F(AxisMachineTest, OldDataStopAPoweredAxisOnly) {
  drive.status.homed = true;
  step();
  clock.sleep_s(10);
  machine.step(channel.latest(), clock.now_s());
  EXPECT_EQ(machine.state(), kDisabled) << "nothing can move";
  stand();
  run_to(80);
  clock.sleep_s(0.29);
  machine.step(channel.latest(), clock.now_s());
  EXPECT_EQ(machine.state(), kDiscreteMotion);
  clock.sleep_s(0.02);
  machine.step(channel.latest(), clock.now_s());
  expect_error(AxisReason::kStaleData);
}

TEST_F(AxisMachineTest, AStallOfTheLoopIsKnownWhenItTurnsAgain) {
  LoopHeartbeat loop;
  loop.beat(clock.now_s());
  stand();
  run_to(80);
  loop.beat(clock.now_s());
  channel.watch(&loop, 0.2, nullptr);
  clock.sleep_s(0.25);
  channel.service();
  EXPECT_TRUE(called("halt")) << "while the loop stands still";
  machine.step(channel.latest(), clock.now_s());
  EXPECT_EQ(machine.error().reason, AxisReason::kLoopStalled);
}

TEST_F(AxisMachineTest, AReadingFromBeforeACommandIsNoNewsOfIt) {
  stand();
  drive.status.in_position = true;  // Of an earlier move that ended at 0.
  ASSERT_EQ(machine.move({0, 10, 100}, clock.now_s()), AxisRefusal::kNone);
  for (int i = 0; i < 5; ++i) {
    clock.sleep_s(0.01);
    machine.step(channel.latest(), clock.now_s());  // The I/O is behind.
    EXPECT_EQ(machine.state(), kDiscreteMotion);
  }
  step();
  EXPECT_EQ(machine.state(), kStandstill);
}

TEST_F(AxisMachineTest, WhatMovesAtStandstillWithoutACommandIsStopped) {
  stand();
  drive.status.position = 9 * kFakeLimits.in_position;
  step();
  EXPECT_EQ(machine.state(), kStandstill);
  drive.status.position = 11 * kFakeLimits.in_position;
  step();
  expect_error(AxisReason::kDrift);
}

TEST_F(AxisMachineTest, AHaltThatDoesNotHelpIsFollowedByTorqueOff) {
  stand();
  run_to(80);
  drive.status.alarm = 7;
  step();
  expect_error(AxisReason::kAlarm);
  for (int i = 0; i < 35; ++i) step();  // Braking time 0.1 s and 0.3 s of patience.
  EXPECT_FALSE(called("servo off"));
  for (int i = 0; i < 10; ++i) step();
  EXPECT_TRUE(called("servo off"));
}

TEST_F(AxisMachineTest, AHaltThatHelpsKeepsTheAxisHeld) {
  stand();
  run_to(80);
  machine.abort({AxisReason::kOtherAxis, 1}, AxisMachine::Torque::kKeep, clock.now_s());
  step();
  drive.status.moving = false;
  for (int i = 0; i < 200; ++i) step();
  EXPECT_EQ(drive.calls, std::vector<std::string>{"halt"});
}

TEST_F(AxisMachineTest, StopCategoriesTakeTheTorqueAtOnceOrAtRest) {
  stand();
  run_to(80);
  machine.abort({AxisReason::kSafety, 1}, AxisMachine::Torque::kOffAtRest, clock.now_s());
  for (int i = 0; i < 10; ++i) step();
  EXPECT_FALSE(called("servo off")) << "still braking";
  drive.status.moving = false;
  settle();
  EXPECT_TRUE(called("servo off"));

  machine.reset(clock.now_s());
  settle();
  stand();
  run_to(80);
  machine.abort({AxisReason::kSafety, 0}, AxisMachine::Torque::kOffAtOnce, clock.now_s());
  channel.service();
  EXPECT_EQ(drive.calls, (std::vector<std::string>{"servo off", "halt"})) << "torque first";
}

TEST_F(AxisMachineTest, BeyondTheSoftLimitsIsAFaultButTheWayInIsNot) {
  drive.status.position = -12;  // Homing may end there.
  stand();
  run_to(50);
  drive.status.position = -11;
  step();
  EXPECT_EQ(machine.state(), kDiscreteMotion);
  drive.status.position = 100.1;
  step();
  expect_error(AxisReason::kSoftLimit);
}

TEST_F(AxisMachineTest, BeforeHomingOnlySlowJogsAndOnlyWhereTheDriveCan) {
  stand(false);
  EXPECT_EQ(machine.move({5, 10, 100}, clock.now_s()), AxisRefusal::kNotHomed);
  EXPECT_EQ(machine.jog({5, 10, 100}, clock.now_s()), AxisRefusal::kCannotMoveUnhomed);
  drive.can_move_unhomed = true;
  ASSERT_EQ(machine.jog({5000, 10, 100}, clock.now_s()), AxisRefusal::kNone) << "no limits are known yet";
  channel.service();
  EXPECT_EQ(drive.last_move.speed, 0.5);
}

TEST_F(AxisMachineTest, WhatIsNoNumberIsRefused) {
  stand();
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  for (const double target : {nan, infinity, -infinity})
    EXPECT_EQ(machine.jog({target, 1, 1}, clock.now_s()), AxisRefusal::kSoftLimit);
  for (const MoveCommand& command : {MoveCommand{1, nan, 1}, MoveCommand{1, 0, 1}, MoveCommand{1, -1, 1},
                                     MoveCommand{1, 1, 0}, MoveCommand{1, infinity, 1}}) {
    EXPECT_EQ(machine.move(command, clock.now_s()), AxisRefusal::kNotANumber);
    EXPECT_EQ(machine.jog(command, clock.now_s()), AxisRefusal::kNotANumber);
  }
  EXPECT_TRUE(drive.calls.empty());
}

TEST_F(AxisMachineTest, SpeedAndAccelerationNeverExceedTheAxis) {
  stand();
  ASSERT_EQ(machine.move({5, 1e6, 1e6}, clock.now_s()), AxisRefusal::kNone);
  channel.service();
  EXPECT_EQ(drive.last_move.speed, 10);
  EXPECT_EQ(drive.last_move.acceleration, 100);
}

TEST_F(AxisMachineTest, AResetThatClearsNothingSaysSo) {
  stand();
  drive.status.alarm = 9;
  drive.reset_clears = false;
  step();
  ASSERT_EQ(machine.state(), kErrorStop);
  ASSERT_EQ(machine.reset(clock.now_s()), AxisRefusal::kNone);
  EXPECT_EQ(machine.check(AxisTrigger::kReset), AxisRefusal::kWrongState) << "one is under way";
  for (int i = 0; i < 110; ++i) step();
  EXPECT_EQ(machine.state(), kErrorStop);
  EXPECT_EQ(machine.error().reason, AxisReason::kResetFailed);
  EXPECT_EQ(machine.error().code, 9);
}

TEST_F(AxisMachineTest, AnAlarmAtPowerOnNeedsAReset) {
  drive.status.alarm = 5;
  step();
  EXPECT_EQ(machine.state(), kErrorStop);
  EXPECT_EQ(machine.enable(clock.now_s()), AxisRefusal::kWrongState);
}

/// A drive that keeps its target: with power it goes on to it, unless it was halted meanwhile.
class StubbornDrive final : public Drive {
 public:
  explicit StubbornDrive(Clock& clock, bool forgets) : clock_(clock), forgets_at_halt_(forgets) {}
  const DriveInfo& info() const override { return info_; }
  Result<void> connect() override { return {}; }
  Result<DriveStatus> read_status() override {
    const double elapsed_s = clock_.now_s() - last_s_;
    last_s_ = clock_.now_s();
    const double way = target_ - position_;
    if (servo_) position_ += std::copysign(std::min(std::abs(way), 10 * elapsed_s), way);
    DriveStatus status;
    status.position = position_;
    status.servo_on = servo_;
    status.homed = true;
    status.moving = servo_ && position_ != target_;
    status.in_position = !status.moving;
    status.sampled_at_s = clock_.now_s();
    return status;
  }
  Result<void> set_servo(bool on) override {
    servo_ = on;
    return {};
  }
  Result<void> start_homing() override { return {}; }
  Result<void> start_move(const MoveCommand& command) override {
    target_ = command.target;
    return {};
  }
  Result<void> halt() override {
    if (forgets_at_halt_) target_ = position_;
    return {};
  }
  Result<void> reset_alarm() override { return {}; }

  double position_ = 0, target_ = 0;

 private:
  DriveInfo info_{"tilt", "stubborn", ""};
  Clock& clock_;
  double last_s_ = 0;
  bool servo_ = false;
  const bool forgets_at_halt_;
};

TEST(AxisReactivation, NeverJumpsToATargetThatTheDriveKept) {
  for (const bool forgets_at_halt : {true, false}) {
    VirtualClock clock;
    StubbornDrive drive(clock, forgets_at_halt);
    DriveChannel channel(drive, clock);
    AxisMachine machine(AxisKind::kLinear, watched(), channel);
    const auto step = [&] {
      clock.sleep_s(0.01);
      channel.service();
      machine.step(channel.latest(), clock.now_s());
    };
    step();
    machine.enable(clock.now_s());
    step();
    ASSERT_EQ(machine.move({80, 10, 100}, clock.now_s()), AxisRefusal::kNone);
    for (int i = 0; i < 100; ++i) step();
    // Power goes, and comes back with the old target still in the drive.
    (void)drive.set_servo(false);
    drive.target_ = 80;
    step();
    ASSERT_EQ(machine.state(), kErrorStop);
    drive.target_ = 80;
    ASSERT_EQ(machine.reset(clock.now_s()), AxisRefusal::kNone);
    step();
    ASSERT_EQ(machine.state(), kDisabled);
    drive.target_ = 80;
    const double before = drive.position_;
    machine.enable(clock.now_s());
    for (int i = 0; i < 300; ++i) step();
    if (forgets_at_halt) {
      EXPECT_EQ(machine.state(), kStandstill);
      EXPECT_EQ(drive.position_, before);
      EXPECT_EQ(machine.target(), before);
    } else {
      // Nothing makes this drive forget: it is caught moving, and loses its power.
      EXPECT_EQ(machine.state(), kErrorStop);
      EXPECT_LT(drive.position_ - before, 6);
      EXPECT_FALSE(channel.latest().status.servo_on);
    }
  }
}

}  // namespace
}  // namespace gantry
