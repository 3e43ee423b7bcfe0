#include "gantry/acquisition/supervisor.h"

#include <gtest/gtest.h>

#include <cmath>

#include "acquisition/motion_rig.h"

namespace gantry {
namespace {

using enum AxisState;

TEST(Supervisor, EveryKindOfTroubleOfOneAxisStopsAllInTheSameCycleAndSoon) {
  struct Trouble {
    const char* name;
    void (*begin)(MotionRig&, size_t axis);
    AxisReason reason;
    double noticed_s;  ///< At most.
  };
  const Trouble troubles[] = {
      {"silence", [](MotionRig& r, size_t i) { r.drives[i]->silent = true; }, AxisReason::kDriveFault, 0.02},
      {"stuck", [](MotionRig& r, size_t i) { r.world->stage(i).inject(StageFault::kStuck, r.clock.now_s()); },
       AxisReason::kFollowingError, 0.15},
      {"runaway",
       [](MotionRig& r, size_t i) { r.world->stage(i).inject(StageFault::kRunawayDown, r.clock.now_s()); },
       AxisReason::kFollowingError, 0.15},
      {"power", [](MotionRig& r, size_t i) { r.world->stage(i).set_servo(false, r.clock.now_s()); },
       AxisReason::kServoLost, 0.02},
  };
  for (const Trouble& trouble : troubles) {
    for (size_t culprit = 0; culprit < MotionRig::kAxes; ++culprit) {
      SCOPED_TRACE(std::string(trouble.name) + " of axis " + std::to_string(culprit));
      MotionRig rig(3);
      rig.home();
      for (auto* drive : rig.drives) ASSERT_TRUE(drive->set_communication_timeout(0.3));
      ASSERT_EQ(rig.request(AxisTrigger::kMove, 7, MotionRig::to(250, 200, 280)), AxisRefusal::kNone);
      rig.steps(80);
      trouble.begin(rig, culprit);
      const double begin_s = rig.clock.now_s();
      while (rig.state(culprit) != kErrorStop && rig.clock.now_s() < begin_s + 1) rig.step();
      EXPECT_LE(rig.clock.now_s() - begin_s, trouble.noticed_s + 1e-9);
      EXPECT_TRUE(rig.all(kErrorStop)) << "in the same cycle";
      const SupervisorStatus status = rig.supervisor->status();
      EXPECT_EQ(status.first_failed, culprit);
      EXPECT_EQ(status.axes[culprit].error.reason, trouble.reason);
      for (size_t i = 0; i < MotionRig::kAxes; ++i)
        if (i != culprit) {
          EXPECT_EQ(status.axes[i].error.reason, AxisReason::kOtherAxis);
        }
      // Braking takes 0.12 s here; a runaway loses its torque 0.5 s after the halt, a silent drive halts by
      // itself.
      rig.steps(60);
      EXPECT_TRUE(rig.at_rest());
    }
  }
}

TEST(Supervisor, ARequestIsTakenForAllAxesOrForNone) {
  MotionRig rig(3);
  rig.home();
  auto moves = MotionRig::to(100, 100, 301);
  EXPECT_EQ(rig.request(AxisTrigger::kMove, 7, moves), AxisRefusal::kSoftLimit);
  EXPECT_EQ(rig.supervisor->status().refused_axis, 2u);
  rig.steps(20);
  EXPECT_TRUE(rig.at_rest());
  EXPECT_TRUE(rig.all(kStandstill));
}

TEST(Supervisor, AnAxisInErrorKeepsTheOthersFromMoving) {
  MotionRig rig(3);
  rig.home();
  rig.request(AxisTrigger::kDisable, 1);
  rig.drives[2]->silent = true;
  rig.steps(5);
  rig.drives[2]->silent = false;
  ASSERT_EQ(rig.state(0), kDisabled) << "nothing to stop there";
  EXPECT_EQ(rig.request(AxisTrigger::kEnable, 1), AxisRefusal::kWrongState);
  EXPECT_EQ(rig.supervisor->status().refused_axis, 1u) << "stopped along with axis 2";
  rig.request(AxisTrigger::kReset);
  rig.steps(10);
  EXPECT_EQ(rig.request(AxisTrigger::kEnable, 7), AxisRefusal::kNone);
}

TEST(Supervisor, TheDeadManStopsAJogAndOnlyAJog) {
  MotionRig rig(3);
  rig.home();
  ASSERT_EQ(rig.request(AxisTrigger::kJog, 1, MotionRig::to(300, 0, 0, 30), true), AxisRefusal::kNone);
  for (int i = 0; i < 100; ++i) {
    rig.supervisor->keep_alive(rig.clock.now_s());
    rig.step();
    ASSERT_EQ(rig.state(0), kDiscreteMotion);
  }
  const double released_s = rig.clock.now_s();
  while (rig.state(0) != kStandstill && rig.clock.now_s() < released_s + 2) rig.step();
  EXPECT_LT(rig.clock.now_s() - released_s, 0.3 + 0.03 + 0.1 + 0.05) << "dead-man time, ramp, settling";
  EXPECT_TRUE(rig.supervisor->status().dead_man_released);
  EXPECT_TRUE(rig.at_rest());
  EXPECT_LT(rig.truth(0).encoder_position, 60);

  ASSERT_EQ(rig.request(AxisTrigger::kMove, 7, MotionRig::to(200, 100, 100)), AxisRefusal::kNone);
  rig.steps(400);
  EXPECT_NEAR(rig.truth(0).encoder_position, 200, 0.05) << "a move needs nobody to hold it";
}

TEST(Supervisor, StopHaltsAllAndKeepsThePower) {
  MotionRig rig(3);
  rig.home();
  rig.request(AxisTrigger::kMove, 7, MotionRig::to(250, 200, 280));
  rig.steps(50);
  rig.supervisor->stop(false);
  rig.steps(60);
  EXPECT_TRUE(rig.all(kStandstill));
  EXPECT_TRUE(rig.at_rest());
  for (size_t i = 0; i < MotionRig::kAxes; ++i) EXPECT_TRUE(rig.truth(i).servo_on);
  EXPECT_LT(rig.truth(0).encoder_position, 150);
}

TEST(Supervisor, AHomingThatIsStoppedStopsTheOthersToo) {
  MotionRig rig(3);
  rig.request(AxisTrigger::kEnable);
  rig.steps(5);
  rig.request(AxisTrigger::kHome, 7);
  rig.steps(20);
  rig.request(AxisTrigger::kStop);
  rig.steps(60);
  EXPECT_TRUE(rig.all(kStandstill));
  EXPECT_TRUE(rig.at_rest());
  for (size_t i = 0; i < MotionRig::kAxes; ++i) EXPECT_FALSE(rig.truth(i).homed);
}

TEST(Supervisor, AHomeSwitchThatIsNotFoundStopsAll) {
  MotionRig rig(3);
  rig.world->stage(1).inject(StageFault::kDeadHomeSwitch, 0);
  rig.request(AxisTrigger::kEnable);
  rig.steps(5);
  rig.request(AxisTrigger::kHome, 7);
  for (int i = 0; i < 2000 && !rig.all(kErrorStop); ++i) rig.step();
  ASSERT_TRUE(rig.all(kErrorStop));
  EXPECT_EQ(rig.supervisor->status().first_failed, 1u);
  EXPECT_EQ(rig.supervisor->status().axes[1].error.reason, AxisReason::kAlarm);
  rig.steps(60);
  EXPECT_TRUE(rig.at_rest());
  // The switch is mended: the documented way back works.
  rig.world->stage(1).clear(StageFault::kDeadHomeSwitch, rig.clock.now_s());
  rig.request(AxisTrigger::kReset);
  rig.steps(10);
  ASSERT_TRUE(rig.all(kDisabled));
  rig.home();
}

TEST(Supervisor, TheSafetyChainStopsByCategoryAndRefusesCommands) {
  for (const StopCategory category : {StopCategory::kCategory0, StopCategory::kCategory1}) {
    MotionRig rig(3);
    rig.home();
    rig.request(AxisTrigger::kMove, 7, MotionRig::to(250, 200, 280));
    rig.steps(60);
    rig.permit.demanded = category;
    rig.step();
    EXPECT_TRUE(rig.all(kErrorStop));
    rig.step();
    const bool powered = rig.truth(0).servo_on;
    EXPECT_EQ(powered, category == StopCategory::kCategory1) << "category 1 brakes under power";
    rig.steps(60);
    for (size_t i = 0; i < MotionRig::kAxes; ++i) EXPECT_FALSE(rig.truth(i).servo_on);
    EXPECT_TRUE(rig.at_rest());
    rig.request(AxisTrigger::kReset);
    rig.steps(10);
    EXPECT_EQ(rig.permit.resets, 1) << "asked in one cycle";
    EXPECT_TRUE(rig.all(kDisabled));
    EXPECT_EQ(rig.request(AxisTrigger::kEnable), AxisRefusal::kSafety);
    rig.permit.demanded = StopCategory::kNone;
    EXPECT_EQ(rig.request(AxisTrigger::kEnable), AxisRefusal::kNone);
    const double before = rig.truth(0).true_position;
    rig.steps(100);
    EXPECT_NEAR(rig.truth(0).true_position, before, 1e-6) << "re-enabling moves nothing";
  }
}

TEST(Supervisor, SettingsAndNumberOfAxesAreChecked) {
  EXPECT_THROW(require_sound(SupervisorSettings{.period_s = 0}), InputError);
  EXPECT_THROW(require_sound(SupervisorSettings{.stall_limit_s = 0.01}), InputError);
  EXPECT_THROW(require_sound(SupervisorSettings{.dead_man_s = std::nan("")}), InputError);
  EXPECT_THROW(Supervisor(std::vector<Axis*>(kMaxAxes + 1), {}, nullptr), InputError);
}

}  // namespace
}  // namespace gantry
