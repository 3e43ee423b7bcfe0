#include "gantry/acquisition/motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace gantry {
namespace {

/// What a test sees and scripts of one drive; outlives it.
struct DriveScript {
  double position = 3, target = 3, begin_s = 0;
  bool servo = false, homed = false, homing = false, halted = false;
  int starts = 0, homings = 0, halts = 0;
  std::optional<Fault> on_read, on_start;
  std::optional<int> alarm;
  bool emergency_stop = false;
  std::function<double(double now_s)> wander = [](double) { return 0.0; };  ///< Of the encoder.
};

/// Every move takes one second, whatever the distance.
class FakeDrive final : public Drive {
 public:
  FakeDrive(std::string axis, DriveScript& script, Clock& clock)
      : info_{axis, "fake", ""}, s_(script), clock_(clock) {}

  const DriveInfo& info() const override { return info_; }
  Result<void> connect() override { return {}; }
  Result<DriveStatus> read_status() override {
    if (s_.on_read) return tl::make_unexpected(*s_.on_read);
    arrive();
    DriveStatus status;
    status.position = s_.position + s_.wander(clock_.now_s());
    status.servo_on = s_.servo;
    status.homed = s_.homed;
    status.moving = s_.position != s_.target;
    status.in_position = !status.moving && !s_.halted && s_.starts > 0;
    status.alarm = s_.alarm;
    status.emergency_stop = s_.emergency_stop;
    status.sampled_at_s = clock_.now_s();
    return status;
  }
  Result<void> set_servo(bool on) override {
    s_.servo = on;
    return {};
  }
  Result<void> start_homing() override {
    ++s_.homings;
    s_.homed = false;
    s_.homing = true;
    return go(0);
  }
  Result<void> start_move(const MoveCommand& command) override {
    if (s_.on_start) return tl::make_unexpected(*s_.on_start);
    ++s_.starts;
    return go(command.target);
  }
  Result<void> halt() override {
    ++s_.halts;
    arrive();
    s_.halted = true;
    s_.target = s_.position;
    s_.homing = false;
    return {};
  }
  Result<void> reset_alarm() override {
    s_.alarm.reset();
    return {};
  }

 private:
  Result<void> go(double target) {
    s_.halted = false;
    s_.target = target;
    s_.begin_s = clock_.now_s();
    return {};
  }
  void arrive() {
    if (clock_.now_s() < s_.begin_s + 1) return;
    s_.position = s_.target;
    s_.homed = s_.homed || s_.homing;
    s_.homing = false;
  }

  DriveInfo info_;
  DriveScript& s_;
  Clock& clock_;
};

constexpr double kBand = 0.03;
const std::vector<double> kTarget = {100, 50, 20};

class MotionTest : public testing::Test {
 protected:
  MotionTest() { make(0.2); }

  void make(double settle_s) {
    const char* names[] = {"linear", "rotation", "tilt"};
    std::vector<std::unique_ptr<Axis>> axes;
    std::vector<AxisSettings> settings;
    TearDown();
    for (size_t i = 0; i < 3; ++i) {
      drives_[i] = {};
      AxisSettings axis;
      axis.name = names[i];
      axis.limits = {.lower = -10, .upper = 300, .speed = 100, .acceleration = 500, .in_position = kBand};
      axis.settle_s = settle_s;
      axes.push_back(std::make_unique<Axis>(std::make_unique<FakeDrive>(names[i], drives_[i], clock_),
                                            axis.kind, axis.limits, clock_));
      settings.push_back(axis);
    }
    motion_ = std::make_unique<Motion>(std::move(axes), settings, MotionOptions{}, clock_);
  }

  /// Motion's end still reads the drives; what a test lets them do may ask for the motion.
  void TearDown() override {
    for (DriveScript& drive : drives_) drive.wander = [](double) { return 0.0; };
    motion_.reset();
  }

  void home() {
    ASSERT_TRUE(motion_->connect());
    ASSERT_TRUE(motion_->enable());
    const auto homed = motion_->home({{"linear"}, {"tilt"}, {"rotation"}});
    ASSERT_TRUE(homed) << homed.error().text();
    ASSERT_TRUE(motion_->homed());
    for (DriveScript& drive : drives_) drive.halts = 0;  // Of the enabling.
  }

  /// Makes `act` happen once, at the first reading after the moves have run for 0.4 s.
  void amid_the_move(std::function<void()> act) {
    const double at_s = clock_.now_s() + 0.4;
    motion_->on_progress([this, at_s, act, done = false](const auto&) mutable {
      if (done || clock_.now_s() < at_s) return;
      done = true;
      act();
    });
  }

  void expect_nothing_moves() {
    clock_.sleep_s(5);
    for (size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(drives_[i].position, drives_[i].target) << "drive " << i;
      EXPECT_NE(drives_[i].position, kTarget[i]) << "drive " << i << " went on to its target";
    }
  }

  VirtualClock clock_;
  DriveScript drives_[3];
  std::unique_ptr<Motion> motion_;
};

TEST_F(MotionTest, HomesInTheOrderGivenAndOneAfterTheOther) {
  ASSERT_TRUE(motion_->connect());
  ASSERT_TRUE(motion_->enable());
  EXPECT_FALSE(motion_->homed());
  ASSERT_TRUE(motion_->home({{"tilt"}, {"linear"}, {"rotation"}}));
  EXPECT_TRUE(motion_->homed());
  EXPECT_LT(drives_[2].begin_s + 1, drives_[0].begin_s + 1e-9);
  EXPECT_LT(drives_[0].begin_s + 1, drives_[1].begin_s + 1e-9);
}

TEST_F(MotionTest, MovesTogetherAndProvesStandstill) {
  ASSERT_NO_FATAL_FAILURE(home());
  drives_[1].wander = [](double now_s) { return 0.2 * kBand * std::sin(40 * now_s); };
  const double before_s = clock_.now_s();
  const auto still = motion_->move_to(kTarget);
  ASSERT_TRUE(still) << still.error().text();
  EXPECT_LT(clock_.now_s() - before_s, 1.5) << "one after the other would take three seconds";
  EXPECT_GE(still->duration_s, 0.2);
  EXPECT_GE(still->samples, 10);
  EXPECT_GT(still->spread, 0.1);
  EXPECT_LE(still->spread, 0.4);
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(still->q[i], kTarget[i], 0.2 * kBand);
  EXPECT_EQ(still->q[0], kTarget[0]);
  const double asked_s = clock_.now_s();
  EXPECT_EQ(*motion_->read_positions(), (std::vector<double>{100, drives_[1].wander(asked_s) + 50, 20}));
}

TEST_F(MotionTest, AFaultOfOneAxisStopsAllOthers) {
  struct Trouble {
    const char* name;
    std::function<void(DriveScript&)> begin;
    FaultKind kind;
  };
  const Trouble troubles[] = {
      {"alarm", [](DriveScript& d) { d.alarm = 0x30; }, FaultKind::kAlarm},
      {"silence",
       [](DriveScript& d) {
         d.on_read = Fault{FaultKind::kTimeout, "axis", "silent"};
       },
       FaultKind::kTimeout},
      {"emergency stop", [](DriveScript& d) { d.emergency_stop = true; }, FaultKind::kRefused},
      {"power lost", [](DriveScript& d) { d.servo = false; }, FaultKind::kProtocol}};
  for (const Trouble& trouble : troubles) {
    for (size_t culprit = 0; culprit < 3; ++culprit) {
      SCOPED_TRACE(std::string(trouble.name) + " of drive " + std::to_string(culprit));
      make(0.2);
      ASSERT_NO_FATAL_FAILURE(home());
      amid_the_move([&] { trouble.begin(drives_[culprit]); });
      const auto moved = motion_->move_to(kTarget);
      ASSERT_FALSE(moved);
      EXPECT_EQ(moved.error().kind, trouble.kind);
      for (size_t i = 0; i < 3; ++i) {
        EXPECT_EQ(motion_->axes()[i]->status().state, AxisState::kErrorStop);
        EXPECT_GE(drives_[i].halts, 1) << "drive " << i;
      }
      expect_nothing_moves();
    }
  }
}

TEST_F(MotionTest, AFaultWhileHomingStopsTheHoming) {
  ASSERT_TRUE(motion_->connect());
  ASSERT_TRUE(motion_->enable());
  amid_the_move([&] { drives_[2].alarm = 0x30; });
  const auto homed = motion_->home({{"linear"}, {"tilt"}, {"rotation"}});
  ASSERT_FALSE(homed);
  EXPECT_EQ(homed.error().kind, FaultKind::kAlarm);
  EXPECT_NE(homed.error().device.find("tilt"), std::string::npos) << homed.error().text();
  EXPECT_EQ(drives_[0].halts, 2) << "at enable, and now";
  EXPECT_EQ(drives_[1].homings + drives_[2].homings, 0) << "the rest of the order is not begun";
  EXPECT_FALSE(motion_->homed());
}

TEST_F(MotionTest, ADriveThatRefusesToStartStopsThoseThatStartedBefore) {
  ASSERT_NO_FATAL_FAILURE(home());
  drives_[2].on_start = Fault{FaultKind::kRefused, "axis tilt", "no"};
  const auto moved = motion_->move_to(kTarget);
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().message, "no");
  EXPECT_EQ(drives_[0].starts + drives_[1].starts, 2);
  EXPECT_EQ(drives_[0].halts, 1);
  EXPECT_EQ(drives_[1].halts, 1);
  expect_nothing_moves();
}

TEST_F(MotionTest, NothingStartsWhenOneTargetIsOutsideItsSoftLimits) {
  ASSERT_NO_FATAL_FAILURE(home());
  for (const double wrong : {-10.01, 300.01, std::numeric_limits<double>::quiet_NaN()}) {
    for (size_t i = 0; i < 3; ++i) {
      std::vector<double> q = kTarget;
      q[i] = wrong;
      const auto moved = motion_->move_to(q);
      ASSERT_FALSE(moved);
      EXPECT_EQ(moved.error().kind, FaultKind::kLimit);
      EXPECT_NE(moved.error().device.find(motion_->axes()[i]->name()), std::string::npos);
      for (const DriveScript& drive : drives_) EXPECT_EQ(drive.starts, 0);
      for (const auto& axis : motion_->axes()) EXPECT_EQ(axis->status().state, AxisState::kStandstill);
    }
  }
  EXPECT_TRUE(motion_->move_to(kTarget)) << "a refusal is no error";
}

TEST_F(MotionTest, NothingMovesBeforeHoming) {
  ASSERT_TRUE(motion_->connect());
  ASSERT_TRUE(motion_->enable());
  const auto moved = motion_->move_to(kTarget);
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().kind, FaultKind::kRefused);
  for (const DriveScript& drive : drives_) EXPECT_EQ(drive.starts, 0);
}

TEST_F(MotionTest, AnEncoderThatWandersIsNoStandstill) {
  for (const double settle_s : {0.2, 0.0}) {
    make(settle_s);
    ASSERT_NO_FATAL_FAILURE(home());
    const double arrived_s = clock_.now_s() + 1;
    // Inside the band until the axis itself is content, outside for most of the time afterwards.
    drives_[1].wander = [&](double now_s) {
      const bool content =
          motion_->axes()[1]->status().state == AxisState::kStandstill && now_s > arrived_s - 0.1;
      return content && std::fmod(now_s, 0.15) > (settle_s == 0 ? -1 : 0.05) ? 2 * kBand : 0.0;
    };
    const auto moved = motion_->move_to(kTarget);
    ASSERT_FALSE(moved) << settle_s;
    EXPECT_EQ(moved.error().kind, FaultKind::kNotSettled);
    EXPECT_NE(moved.error().device.find("rotation"), std::string::npos) << moved.error().text();
    EXPECT_LT(clock_.now_s() - arrived_s, 7) << "gives up in time";
  }
}

TEST_F(MotionTest, StandstillIsCountedFromWhenTheLastAxisCameToRest) {
  ASSERT_NO_FATAL_FAILURE(home());
  const double arrived_s = clock_.now_s() + 1;
  drives_[2].wander = [=](double now_s) {
    return now_s > arrived_s + 0.05 && now_s < arrived_s + 1.2 ? 1.5 * kBand : 0.0;
  };
  const auto still = motion_->move_to(kTarget);
  ASSERT_TRUE(still) << still.error().text();
  EXPECT_GE(clock_.now_s(), arrived_s + 1.4);
  EXPECT_GE(still->duration_s, 0.2);
  EXPECT_EQ(still->spread, 0) << "readings from before do not count";
}

TEST_F(MotionTest, CancelStopsAll) {
  ASSERT_NO_FATAL_FAILURE(home());
  bool cancelled = false;
  motion_->cancel_when([&] { return cancelled; });
  amid_the_move([&] { cancelled = true; });
  const auto moved = motion_->move_to(kTarget);
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().kind, FaultKind::kRefused);
  for (const DriveScript& drive : drives_) EXPECT_EQ(drive.halts, 1);
  expect_nothing_moves();
}

TEST_F(MotionTest, ResetAndEnableRecover) {
  ASSERT_NO_FATAL_FAILURE(home());
  amid_the_move([&] { drives_[0].alarm = 0x30; });
  ASSERT_FALSE(motion_->move_to(kTarget));
  EXPECT_FALSE(motion_->move_to(kTarget)) << "an error stays until it is reset";
  ASSERT_TRUE(motion_->reset());
  ASSERT_TRUE(motion_->enable());
  EXPECT_TRUE(motion_->move_to(kTarget));
}

TEST_F(MotionTest, ItsEndStopsWhatMoves) {
  ASSERT_NO_FATAL_FAILURE(home());
  ASSERT_TRUE(motion_->start_jog(0, 1));
  ASSERT_TRUE(motion_->watch_for(0.05));
  ASSERT_NE(drives_[0].position, drives_[0].target);
  motion_.reset();
  for (const DriveScript& drive : drives_) EXPECT_GE(drive.halts, 1);
  expect_nothing_moves();
}

TEST_F(MotionTest, AxesOfOneGroupHomeAtTheSameTime) {
  ASSERT_TRUE(motion_->connect());
  ASSERT_TRUE(motion_->enable());
  ASSERT_TRUE(motion_->home({{"tilt", "rotation"}, {"linear"}}));
  EXPECT_EQ(drives_[1].begin_s, drives_[2].begin_s);
  EXPECT_GT(drives_[0].begin_s, drives_[1].begin_s + 1);
  const auto unknown = motion_->home({{"yaw"}});
  ASSERT_FALSE(unknown);
  EXPECT_NE(unknown.error().message.find("'yaw'"), std::string::npos);
}

TEST_F(MotionTest, WhatThePermitReadsIsServicedInEveryCycle) {
  struct Contact final : MotionPermit {
    StopCategory required_stop(double, bool) override {
      return read_closed ? StopCategory::kNone : StopCategory::kCategory0;
    }
    std::string why() const override { return "the door is open"; }
    bool closed = true, read_closed = false;
  } door;
  std::vector<std::unique_ptr<Axis>> axes;
  axes.push_back(std::make_unique<Axis>(std::make_unique<FakeDrive>("linear", drives_[0], clock_),
                                        AxisKind::kLinear, motion_->axes()[0]->limits(), clock_));
  MotionOptions options;
  options.services = {{0, [&] { door.read_closed = door.closed; }}};
  Motion motion(std::move(axes), {AxisSettings{}}, options, clock_, &door);
  ASSERT_TRUE(motion.connect() && motion.enable() && motion.home({{"linear"}}));
  motion.on_progress([&](const auto&) { door.closed = false; });
  const auto moved = motion.move_to(std::vector<double>{50});
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().text(), "safety chain: the door is open [refused]");
  EXPECT_FALSE(drives_[0].servo);
  const auto enabled = motion.enable();
  ASSERT_FALSE(enabled);
  EXPECT_EQ(enabled.error().message, "the door is open");
}

TEST_F(MotionTest, RefusalsSayWhatToDo) {
  ASSERT_TRUE(motion_->connect());
  ASSERT_TRUE(motion_->enable());
  const auto moved = motion_->move_to(kTarget);
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().message, "move refused: linear is not homed; run gantry-cell home --axis linear");
  const auto jogged = motion_->jog_by(2, 1);
  ASSERT_FALSE(jogged);
  EXPECT_NE(jogged.error().message.find("home --axis tilt"), std::string::npos) << jogged.error().message;
}

TEST_F(MotionTest, ThePathIsCheckedBeforeTheFirstStep) {
  ASSERT_NO_FATAL_FAILURE(home());
  std::vector<std::vector<double>> asked;
  bool allow = false;
  motion_->set_path_check([&](std::span<const double> from, std::span<const double> to) -> Result<void> {
    asked.emplace_back(from.begin(), from.end());
    asked.emplace_back(to.begin(), to.end());
    if (!allow) return fault(FaultKind::kLimit, "cell", "part would meet the sensor");
    return {};
  });
  const auto refused = motion_->move_to(kTarget);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().message, "part would meet the sensor");
  EXPECT_EQ(asked, (std::vector<std::vector<double>>{{0, 0, 0}, kTarget}));
  for (const DriveScript& drive : drives_) EXPECT_EQ(drive.starts, 0);
  for (const auto& status : motion_->statuses()) EXPECT_EQ(status.state, AxisState::kStandstill);
  allow = true;
  EXPECT_TRUE(motion_->move_to(kTarget));
}

}  // namespace
}  // namespace gantry
