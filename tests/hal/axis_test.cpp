#include "gantry/hal/axis.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <vector>

#include "hal/fake_drive.h"

namespace gantry {
namespace {

class AxisTest : public testing::Test {
 protected:
  AxisTest() : AxisTest(std::make_unique<FakeDrive>()) {}

  Fault lost() const { return {FaultKind::kTimeout, axis.info().text(), "no answer"}; }

  void enable_homed() {
    drive.status.homed = true;
    ASSERT_TRUE(axis.connect());
    ASSERT_TRUE(axis.enable());
  }

  /// Brings a fresh axis into the state, homed, by legal commands only.
  void bring_to(AxisState state) {
    drive.status.homed = true;
    ASSERT_TRUE(axis.connect());
    if (state != AxisState::kDisabled) {
      ASSERT_TRUE(axis.enable());
    }
    switch (state) {
      case AxisState::kHoming:
        ASSERT_TRUE(axis.home());
        break;
      case AxisState::kDiscreteMotion:
        ASSERT_TRUE(axis.move_to(50));
        break;
      case AxisState::kStopping:
        ASSERT_TRUE(axis.stop());
        break;
      case AxisState::kErrorStop:
        axis.abort();
        break;
      default:
        break;
    }
    ASSERT_EQ(axis.status().state, state);
    drive.calls.clear();
  }

  std::vector<std::string> last_two() const { return {drive.calls.end() - 2, drive.calls.end()}; }

  VirtualClock clock;
  FakeDrive& drive;
  Axis axis;

 private:
  explicit AxisTest(std::unique_ptr<FakeDrive> fake)
      : drive(*fake), axis(std::move(fake), AxisKind::kLinear, kFakeLimits, clock) {
    drive.clock = &clock;
  }
};

// ---- Every command in every state -------------------------------------------------------------

struct Command {
  const char* name;
  Result<void> (*run)(Axis&);
  std::map<AxisState, AxisState> legal;  ///< From -> to, seen right after the command.
};

using enum AxisState;
const AxisState kStates[] = {kDisabled, kStandstill, kHoming, kDiscreteMotion, kStopping, kErrorStop};
const Command kCommands[] = {
    {"enable", [](Axis& a) { return a.enable(); }, {{kDisabled, kStandstill}}},
    {"disable", [](Axis& a) { return a.disable(); }, {{kStandstill, kDisabled}, {kDisabled, kDisabled}}},
    {"home", [](Axis& a) { return a.home(); }, {{kStandstill, kHoming}}},
    {"move", [](Axis& a) { return a.move_to(50); }, {{kStandstill, kDiscreteMotion}}},
    {"stop",
     [](Axis& a) { return a.stop(); },
     {{kStandstill, kStopping}, {kHoming, kStopping}, {kDiscreteMotion, kStopping}, {kStopping, kStopping}}},
    {"reset", [](Axis& a) { return a.reset(); }, {{kErrorStop, kDisabled}}},
};

class AxisTransitions : public AxisTest,
                        public testing::WithParamInterface<std::tuple<AxisState, Command>> {};

TEST_P(AxisTransitions, AreLegalOrRefusedWithoutTouchingTheDrive) {
  const auto& [state, command] = GetParam();
  bring_to(state);
  const auto done = command.run(axis);
  if (const auto legal = command.legal.find(state); legal != command.legal.end()) {
    ASSERT_TRUE(done) << done.error().text();
    EXPECT_EQ(axis.status().state, legal->second);
    EXPECT_FALSE(drive.calls.empty());
  } else {
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().kind, FaultKind::kRefused);
    EXPECT_NE(done.error().text().find("axis tilt"), std::string::npos);
    EXPECT_NE(done.error().text().find(to_string(state)), std::string::npos);
    EXPECT_EQ(axis.status().state, state);
    EXPECT_TRUE(drive.calls.empty()) << drive.calls.front();
  }
}

INSTANTIATE_TEST_SUITE_P(All, AxisTransitions,
                         testing::Combine(testing::ValuesIn(kStates), testing::ValuesIn(kCommands)),
                         [](const auto& p) {
                           return std::string(to_string(std::get<0>(p.param))) + "_" +
                                  std::get<1>(p.param).name;
                         });

// ---- Rules of motion --------------------------------------------------------------------------

TEST_F(AxisTest, NothingMovesBeforeHoming) {
  ASSERT_TRUE(axis.connect());
  ASSERT_TRUE(axis.enable());
  drive.calls.clear();
  const auto moved = axis.move_to(50);
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().kind, FaultKind::kRefused);
  EXPECT_NE(moved.error().message.find("not homed"), std::string::npos);
  EXPECT_EQ(axis.status().state, kStandstill);
  EXPECT_TRUE(drive.calls.empty());
}

TEST_F(AxisTest, SoftLimitsAreInclusiveAndNothingElsePasses) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  enable_homed();
  drive.calls.clear();
  for (const double target : {std::nextafter(-10.0, -kInfinity), std::nextafter(100.0, kInfinity), -1e9, 1e9,
                              kInfinity, -kInfinity, std::nan("")}) {
    const auto moved = axis.move_to(target);
    ASSERT_FALSE(moved) << target;
    EXPECT_EQ(moved.error().kind, FaultKind::kLimit);
    EXPECT_EQ(axis.status().state, kStandstill);
  }
  EXPECT_TRUE(drive.calls.empty());
  for (const double target : {-10.0, 100.0}) {
    ASSERT_TRUE(axis.move_to(target));
    drive.status.position = target;
    drive.status.in_position = true;
    ASSERT_TRUE(axis.update());
    ASSERT_EQ(axis.status().state, kStandstill);
  }
}

TEST_F(AxisTest, AMoveCarriesTheLimitsOfTheAxis) {
  enable_homed();
  ASSERT_TRUE(axis.move_to(42));
  EXPECT_EQ(drive.last_move.target, 42);
  EXPECT_EQ(drive.last_move.speed, kFakeLimits.speed);
  EXPECT_EQ(drive.last_move.acceleration, kFakeLimits.acceleration);
}

TEST_F(AxisTest, TheTargetIsTheActualPositionAfterEveryEnable) {
  enable_homed();
  ASSERT_TRUE(axis.move_to(80));
  drive.status.position = 33;
  axis.abort();
  ASSERT_TRUE(axis.reset());
  drive.status.position = 31.5;  // Moved by hand meanwhile.
  drive.calls.clear();
  ASSERT_TRUE(axis.enable());
  EXPECT_EQ(axis.status().target, 31.5);
  EXPECT_EQ(drive.calls, (std::vector<std::string>{"halt", "servo on"}))
      << "what is left of a travel goes first";
}

TEST_F(AxisTest, ArrivalNeedsTheDriveTheEncoderAndStandstill) {
  enable_homed();
  drive.status.in_position = true;  // Left over from an earlier move.
  ASSERT_TRUE(axis.move_to(50));
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kDiscreteMotion) << "far from the target";
  drive.status.position = 50.015;
  drive.status.moving = true;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kDiscreteMotion) << "still moving";
  drive.status.moving = false;
  drive.status.in_position = false;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kDiscreteMotion) << "the drive does not agree";
  drive.status.in_position = true;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kStandstill);
}

TEST_F(AxisTest, HomingEndsWhenTheDriveSaysSoAndStandsStill) {
  ASSERT_TRUE(axis.connect());
  ASSERT_TRUE(axis.enable());
  ASSERT_TRUE(axis.home());
  drive.status.moving = true;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kHoming);
  drive.status.homed = true;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kHoming);
  drive.status.moving = false;
  drive.status.position = 0.01;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kStandstill);
  EXPECT_EQ(axis.status().target, 0.01);
}

TEST_F(AxisTest, StopEndsInStandstillWhereItStopped) {
  bring_to(kDiscreteMotion);
  drive.status.moving = true;
  ASSERT_TRUE(axis.stop());
  EXPECT_EQ(drive.calls, std::vector<std::string>{"halt"});
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kStopping);
  drive.status.moving = false;
  drive.status.position = 17;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kStandstill);
  EXPECT_EQ(axis.status().target, 17);
}

TEST_F(AxisTest, ConnectingAgainInMotionKeepsTheTarget) {
  bring_to(kDiscreteMotion);
  ASSERT_TRUE(axis.connect());
  EXPECT_EQ(axis.status().target, 50);
  EXPECT_EQ(axis.status().state, kDiscreteMotion);
}

// ---- Errors -----------------------------------------------------------------------------------

class AxisErrors : public AxisTest, public testing::WithParamInterface<AxisState> {};

TEST_P(AxisErrors, ALostDriveLeadsToErrorStopAndTheHaltIsMadeUpFor) {
  bring_to(GetParam());
  drive.status.moving = true;
  drive.read_fault = lost();
  drive.faults["halt"] = lost();
  const auto updated = axis.update();
  ASSERT_FALSE(updated);
  EXPECT_EQ(updated.error().kind, FaultKind::kTimeout);
  EXPECT_EQ(axis.status().state, kErrorStop);
  EXPECT_EQ(axis.status().error, "no answer");

  drive.read_fault.reset();
  drive.faults.clear();
  drive.calls.clear();
  ASSERT_TRUE(axis.update());
  ASSERT_TRUE(axis.update());
  const bool was_powered = GetParam() != kDisabled;
  EXPECT_EQ(drive.calls, was_powered ? std::vector<std::string>{"halt"} : std::vector<std::string>{});
}

/// With the motor under power; an unpowered axis may have an alarm pending.
class AxisPoweredErrors : public AxisErrors {};

TEST_P(AxisPoweredErrors, AnAlarmLeadsToErrorStop) {
  bring_to(GetParam());
  drive.status.alarm = 0x30;
  const auto updated = axis.update();
  ASSERT_FALSE(updated);
  EXPECT_EQ(updated.error().kind, FaultKind::kAlarm);
  EXPECT_NE(updated.error().message.find("48"), std::string::npos);
  EXPECT_EQ(axis.status().state, kErrorStop);
  EXPECT_EQ(drive.calls, std::vector<std::string>{"halt"});
}

TEST_P(AxisPoweredErrors, TheEmergencyStopIsLatchedAndReleasingItPowersNothing) {
  bring_to(GetParam());
  drive.status.emergency_stop = true;
  ASSERT_FALSE(axis.update());
  EXPECT_EQ(axis.status().state, kErrorStop);
  EXPECT_EQ(drive.calls, (std::vector<std::string>{"servo off", "halt"}));
  drive.status.emergency_stop = false;
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, kErrorStop) << "needs a reset";
}

TEST_P(AxisPoweredErrors, AServoThatDropsOutIsNoticed) {
  bring_to(GetParam());
  drive.status.servo_on = false;
  ASSERT_FALSE(axis.update());
  EXPECT_EQ(axis.status().state, kErrorStop);
}

TEST_P(AxisErrors, AbortHaltsAPoweredAxisOnceAndLeavesADisabledOneAlone) {
  bring_to(GetParam());
  axis.abort();
  axis.abort();
  if (GetParam() == kDisabled) {
    EXPECT_EQ(axis.status().state, kDisabled);
    EXPECT_TRUE(drive.calls.empty());
    return;
  }
  EXPECT_EQ(axis.status().state, kErrorStop);
  EXPECT_EQ(drive.calls, std::vector<std::string>{"halt"});
  const auto refused = axis.home();
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("stopped on request"), std::string::npos);
  EXPECT_NE(refused.error().message.find("gantry-cell reset"), std::string::npos);
}

INSTANTIATE_TEST_SUITE_P(FromEveryState, AxisErrors,
                         testing::Values(kDisabled, kStandstill, kHoming, kDiscreteMotion, kStopping),
                         [](const auto& p) { return std::string(to_string(p.param)); });

INSTANTIATE_TEST_SUITE_P(FromEveryState, AxisPoweredErrors,
                         testing::Values(kStandstill, kHoming, kDiscreteMotion, kStopping),
                         [](const auto& p) { return std::string(to_string(p.param)); });

struct FailingCall {
  const char* call;
  AxisState from;
  Result<void> (*run)(Axis&);
};

class AxisCommandFaults : public AxisTest, public testing::WithParamInterface<FailingCall> {};

TEST_P(AxisCommandFaults, LeadToErrorStopAndReportTheFaultOfTheDrive) {
  bring_to(GetParam().from);
  drive.faults[GetParam().call] = lost();
  const auto done = GetParam().run(axis);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, FaultKind::kTimeout);
  EXPECT_EQ(axis.status().state, kErrorStop);
}

INSTANTIATE_TEST_SUITE_P(
    All, AxisCommandFaults,
    testing::Values(FailingCall{"servo on", kDisabled, [](Axis& a) { return a.enable(); }},
                    FailingCall{"servo off", kStandstill, [](Axis& a) { return a.disable(); }},
                    FailingCall{"home", kStandstill, [](Axis& a) { return a.home(); }},
                    FailingCall{"move", kStandstill, [](Axis& a) { return a.move_to(1); }},
                    FailingCall{"halt", kDiscreteMotion, [](Axis& a) { return a.stop(); }}),
    [](const auto& p) {
      std::string name = p.param.call;
      std::erase(name, ' ');
      return name;
    });

TEST_F(AxisTest, EnableGivesUpAndLeavesTheServoCommandOff) {
  ASSERT_TRUE(axis.connect());
  drive.obeys_servo = false;
  auto enabled = axis.enable();
  ASSERT_FALSE(enabled);
  EXPECT_EQ(enabled.error().kind, FaultKind::kTimeout);
  EXPECT_EQ(last_two(), (std::vector<std::string>{"servo off", "halt"}));
  EXPECT_NEAR(clock.now_s(), 2.0, 0.1);

  drive.obeys_servo = true;
  ASSERT_TRUE(axis.reset());
  drive.status.emergency_stop = true;
  ASSERT_FALSE(axis.enable());
  EXPECT_EQ(last_two(), (std::vector<std::string>{"servo off", "halt"}));
  EXPECT_FALSE(drive.status.servo_on);

  EXPECT_FALSE(axis.reset()) << "the button is still pressed";
  drive.status.emergency_stop = false;
  ASSERT_TRUE(axis.reset());
  drive.status.alarm = 7;
  enabled = axis.enable();
  ASSERT_FALSE(enabled);
  EXPECT_EQ(enabled.error().kind, FaultKind::kAlarm);
  EXPECT_EQ(last_two(), (std::vector<std::string>{"servo off", "halt"}));
}

TEST_F(AxisTest, ResetThatFailsStaysInErrorStop) {
  bring_to(kErrorStop);
  for (const char* call : {"reset alarm", "servo off"}) {
    drive.faults = {{call, lost()}};
    EXPECT_FALSE(axis.reset());
    EXPECT_EQ(axis.status().state, kErrorStop);
  }
  drive.faults.clear();
  ASSERT_TRUE(axis.reset());
  EXPECT_EQ(axis.status().error, "");
  EXPECT_FALSE(drive.status.servo_on);
}

struct LateCase {
  AxisState state;
  double allowed_s;  ///< Just within the time limit of the operation.
  FaultKind kind;
};

class AxisTimeLimits : public AxisTest, public testing::WithParamInterface<LateCase> {};

TEST_P(AxisTimeLimits, EndAnOperationThatDoesNot) {
  bring_to(GetParam().state);
  drive.status.homed = false;
  drive.status.moving = true;
  clock.sleep_s(GetParam().allowed_s);
  ASSERT_TRUE(axis.update());
  EXPECT_EQ(axis.status().state, GetParam().state);
  clock.sleep_s(0.2);
  const auto late = axis.update();
  ASSERT_FALSE(late);
  EXPECT_EQ(late.error().kind, GetParam().kind);
  EXPECT_EQ(axis.status().state, kErrorStop);
  EXPECT_EQ(drive.calls.back(), "halt");
}

// Move of 50 mm at 10 mm/s: 5 s + 2 * 0.1 s of ramps + 2 s of margin. Stop: 0.2 s + 2 s.
INSTANTIATE_TEST_SUITE_P(All, AxisTimeLimits,
                         testing::Values(LateCase{kHoming, 19.9, FaultKind::kTimeout},
                                         LateCase{kDiscreteMotion, 7.1, FaultKind::kNotSettled},
                                         LateCase{kStopping, 2.1, FaultKind::kNotSettled}),
                         [](const auto& p) { return std::string(to_string(p.param.state)); });

// ---- Construction -----------------------------------------------------------------------------

TEST(AxisLimitsTest, ContradictionsAreRejectedByName) {
  VirtualClock clock;
  const auto make = [&clock](AxisLimits limits) {
    Axis axis(std::make_unique<FakeDrive>(), AxisKind::kLinear, limits, clock);
  };
  EXPECT_NO_THROW(make(kFakeLimits));
  for (auto break_it : {+[](AxisLimits& l) { std::swap(l.lower, l.upper); },  //
                        +[](AxisLimits& l) { l.upper = l.lower; },            //
                        +[](AxisLimits& l) { l.upper = std::nan(""); },       //
                        +[](AxisLimits& l) { l.speed = 0; },                  //
                        +[](AxisLimits& l) { l.acceleration = -1; },          //
                        +[](AxisLimits& l) { l.in_position = std::nan(""); }}) {
    AxisLimits limits = kFakeLimits;
    break_it(limits);
    EXPECT_THROW(make(limits), InputError);
  }
}

TEST(AxisFormat, SpeaksMillimetresOrDegrees) {
  VirtualClock clock;
  const Axis linear(std::make_unique<FakeDrive>(), AxisKind::kLinear, kFakeLimits, clock);
  const Axis rotary(std::make_unique<FakeDrive>(), AxisKind::kRotary, kFakeLimits, clock);
  EXPECT_EQ(linear.format(12.5), "12.50 mm");
  EXPECT_EQ(rotary.format(-M_PI / 6), "-30.00 deg");
}

}  // namespace
}  // namespace gantry
