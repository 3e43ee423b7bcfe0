#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "gantry/hal/axis.h"

namespace gantry {

/// An axis on some drive, real or simulated, with what the conformance tests need around it. Fresh for
/// each test: not connected, not homed, somewhere within its soft limits.
class AxisRig {
 public:
  virtual ~AxisRig() = default;
  virtual Axis& axis() = 0;
  /// The clock of the axis.
  virtual Clock& clock() = 0;
  /// Lets time pass, for the axis and for the device.
  virtual void advance(double duration_s) { clock().sleep_s(duration_s); }
  /// Fault injection, where the rig has it: false means it has not, and the test is skipped.
  virtual bool raise_alarm() { return false; }
  virtual bool set_emergency_stop(bool /*active*/) { return false; }
};

using MakeAxisRig = std::function<std::unique_ptr<AxisRig>()>;

/// What every Drive must do behind an Axis. One suite for all implementations, so that code that works
/// with one of them works with all.
namespace axis_conformance {

using enum AxisState;

#define GANTRY_ASSERT_DONE(result)                          \
  do {                                                      \
    const auto& done_ = (result);                           \
    ASSERT_TRUE(done_.has_value()) << done_.error().text(); \
  } while (false)

/// Updates every `step_s` until the axis leaves `state` or fails; the test fails after `limit_s`.
inline void update_while(AxisRig& rig, AxisState state, double limit_s = 100, double step_s = 0.01,
                         const std::function<void(const AxisStatus&)>& see = {}) {
  const double deadline_s = rig.clock().now_s() + limit_s;
  for (;;) {
    const auto status = rig.axis().update();
    GANTRY_ASSERT_DONE(status);
    if (see) see(*status);
    if (status->state != state) return;
    ASSERT_LT(rig.clock().now_s(), deadline_s) << "still in " << to_string(state);
    rig.advance(step_s);
  }
}

inline double at_fraction(const AxisRig& rig, double fraction) {
  const AxisLimits& limits = const_cast<AxisRig&>(rig).axis().limits();
  return limits.lower + fraction * (limits.upper - limits.lower);
}

inline void enable(AxisRig& rig) {
  GANTRY_ASSERT_DONE(rig.axis().connect());
  GANTRY_ASSERT_DONE(rig.axis().enable());
}

inline void home(AxisRig& rig) {
  GANTRY_ASSERT_DONE(rig.axis().home());
  update_while(rig, kHoming);
  ASSERT_EQ(rig.axis().status().state, kStandstill);
  ASSERT_TRUE(rig.axis().status().drive.homed);
}

inline void move(AxisRig& rig, double target) {
  GANTRY_ASSERT_DONE(rig.axis().move_to(target));
  update_while(rig, kDiscreteMotion);
  ASSERT_EQ(rig.axis().status().state, kStandstill);
  ASSERT_NEAR(rig.axis().status().drive.position, target, rig.axis().limits().in_position);
}

/// Starts from one end towards the other and returns after about `fraction` of the way.
inline void be_in_mid_move(AxisRig& rig, double fraction = 0.4) {
  enable(rig);
  home(rig);
  move(rig, at_fraction(rig, 0.05));
  GANTRY_ASSERT_DONE(rig.axis().move_to(at_fraction(rig, 0.95)));
  const double passed = at_fraction(rig, 0.05 + 0.9 * fraction);
  double position = 0;
  do {
    rig.advance(0.01);
    const auto status = rig.axis().update();
    GANTRY_ASSERT_DONE(status);
    ASSERT_EQ(status->state, kDiscreteMotion);
    position = status->drive.position;
  } while (position < passed);
  ASSERT_TRUE(rig.axis().status().drive.moving);
}

/// The device stands still, and goes on doing so.
inline void expect_rest(AxisRig& rig, double duration_s = 0.5) {
  (void)rig.axis().update();
  const double position = rig.axis().status().drive.position;
  EXPECT_FALSE(rig.axis().status().drive.moving);
  const double end_s = rig.clock().now_s() + duration_s;
  while (rig.clock().now_s() < end_s) {
    rig.advance(0.05);
    (void)rig.axis().update();
    ASSERT_NEAR(rig.axis().status().drive.position, position, rig.axis().limits().in_position);
    ASSERT_FALSE(rig.axis().status().drive.moving);
  }
}

/// Waits until the device itself, in whatever state the axis is, reports no motion.
inline void wait_for_rest(AxisRig& rig) {
  const double deadline_s = rig.clock().now_s() + 20;
  do {
    ASSERT_LT(rig.clock().now_s(), deadline_s) << "still moving";
    rig.advance(0.01);
    GANTRY_ASSERT_DONE(rig.axis().update());
  } while (rig.axis().status().drive.moving);
}

// ---- The tests --------------------------------------------------------------------------------

inline void connects_and_names_itself(AxisRig& rig) {
  GANTRY_ASSERT_DONE(rig.axis().connect());
  EXPECT_FALSE(rig.axis().info().axis.empty());
  EXPECT_FALSE(rig.axis().info().model.empty());
  EXPECT_EQ(rig.axis().status().state, kDisabled);
  GANTRY_ASSERT_DONE(rig.axis().connect());
}

inline void status_is_fresh_in_every_state(AxisRig& rig) {
  GANTRY_ASSERT_DONE(rig.axis().connect());
  rig.advance(1.0);
  const double before_s = rig.clock().now_s();
  const auto status = rig.axis().update();
  GANTRY_ASSERT_DONE(status);
  EXPECT_EQ(status->state, kDisabled);
  EXPECT_GE(status->drive.sampled_at_s, before_s);
  EXPECT_LE(status->drive.sampled_at_s, rig.clock().now_s());
  EXPECT_FALSE(status->drive.moving);
  EXPECT_FALSE(status->drive.in_position) << "nothing was commanded yet";
  EXPECT_FALSE(status->drive.alarm.has_value());
  expect_rest(rig);
}

inline void enabling_moves_nothing(AxisRig& rig) {
  GANTRY_ASSERT_DONE(rig.axis().connect());
  const double before = rig.axis().status().drive.position;
  GANTRY_ASSERT_DONE(rig.axis().enable());
  EXPECT_EQ(rig.axis().status().state, kStandstill);
  EXPECT_TRUE(rig.axis().status().drive.servo_on);
  EXPECT_EQ(rig.axis().status().target, rig.axis().status().drive.position);
  expect_rest(rig);
  EXPECT_NEAR(rig.axis().status().drive.position, before, rig.axis().limits().in_position);
}

inline void nothing_moves_before_homing(AxisRig& rig) {
  enable(rig);
  ASSERT_FALSE(rig.axis().status().drive.homed);
  const auto refused = rig.axis().move_to(at_fraction(rig, 0.5));
  ASSERT_FALSE(refused.has_value());
  EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
  expect_rest(rig);
}

inline void homes_as_often_as_asked(AxisRig& rig) {
  enable(rig);
  home(rig);
  EXPECT_EQ(rig.axis().status().target, rig.axis().status().drive.position);
  expect_rest(rig);
  const double home_position = rig.axis().status().drive.position;
  move(rig, at_fraction(rig, 0.8));
  // The second time the drive is homed already: that must not pass for the end of this homing.
  GANTRY_ASSERT_DONE(rig.axis().home());
  GANTRY_ASSERT_DONE(rig.axis().update());
  EXPECT_EQ(rig.axis().status().state, kHoming);
  update_while(rig, kHoming);
  EXPECT_EQ(rig.axis().status().state, kStandstill);
  EXPECT_NEAR(rig.axis().status().drive.position, home_position, rig.axis().limits().in_position);
}

inline void moves_arrive_and_stay(AxisRig& rig) {
  enable(rig);
  home(rig);
  for (const double fraction : {0.0, 1.0, 0.37, 0.371, 0.9, 0.123456789}) {
    move(rig, at_fraction(rig, fraction));
    if (testing::Test::HasFatalFailure()) return;
    expect_rest(rig, 0.2);
  }
}

inline void a_move_is_not_over_before_it_began(AxisRig& rig) {
  enable(rig);
  home(rig);
  const AxisLimits& limits = rig.axis().limits();
  for (const double fraction : {0.2, 0.8, 0.2}) {
    const double target = at_fraction(rig, fraction);
    const double distance = std::abs(target - rig.axis().status().drive.position);
    const double started_s = rig.clock().now_s();
    GANTRY_ASSERT_DONE(rig.axis().move_to(target));
    // At once, several times: the drive may still show the end of the move before.
    for (int i = 0; i < 5; ++i) {
      const auto status = rig.axis().update();
      GANTRY_ASSERT_DONE(status);
      ASSERT_EQ(status->state, kDiscreteMotion);
      ASSERT_FALSE(status->drive.in_position);
    }
    update_while(rig, kDiscreteMotion, 100, 0.002, [&](const AxisStatus& status) {
      if (!status.drive.in_position) return;
      EXPECT_FALSE(status.drive.moving);
      EXPECT_NEAR(status.drive.position, target, limits.in_position);
    });
    if (testing::Test::HasFatalFailure()) return;
    EXPECT_TRUE(rig.axis().status().drive.in_position);
    EXPECT_GE(rig.clock().now_s() - started_s, 0.99 * distance / limits.speed);
  }
}

inline void tiny_moves_end_too(AxisRig& rig) {
  enable(rig);
  home(rig);
  const double band = rig.axis().limits().in_position;
  double target = at_fraction(rig, 0.5);
  move(rig, target);
  for (const double step : {0.0, 0.4 * band, -0.2 * band, 3 * band, 0.0}) {
    target += step;
    const double started_s = rig.clock().now_s();
    move(rig, target);
    if (testing::Test::HasFatalFailure()) return;
    EXPECT_LT(rig.clock().now_s() - started_s, 2.0) << "step " << step;
  }
}

inline void stop_in_mid_move_ends_before_the_target(AxisRig& rig) {
  be_in_mid_move(rig);
  if (testing::Test::HasFatalFailure()) return;
  const double stopped_at = rig.axis().status().drive.position;
  GANTRY_ASSERT_DONE(rig.axis().stop());
  EXPECT_EQ(rig.axis().status().state, kStopping);
  update_while(rig, kStopping, 20);
  ASSERT_EQ(rig.axis().status().state, kStandstill);
  const double rest = rig.axis().status().drive.position;
  EXPECT_GE(rest, stopped_at);
  EXPECT_LT(rest, at_fraction(rig, 0.9));
  EXPECT_EQ(rig.axis().status().target, rest);
  EXPECT_FALSE(rig.axis().status().drive.in_position) << "the move did not end at its target";
  expect_rest(rig);

  // Neither power nor a new command may revive the rest of the travel.
  GANTRY_ASSERT_DONE(rig.axis().disable());
  GANTRY_ASSERT_DONE(rig.axis().enable());
  expect_rest(rig);
  EXPECT_NEAR(rig.axis().status().drive.position, rest, rig.axis().limits().in_position);
  move(rig, at_fraction(rig, 0.1));
  expect_rest(rig);
}

inline void stop_right_after_a_command_wins(AxisRig& rig) {
  enable(rig);
  home(rig);
  const double start = rig.axis().status().drive.position;
  GANTRY_ASSERT_DONE(rig.axis().move_to(at_fraction(rig, start > at_fraction(rig, 0.5) ? 0.0 : 1.0)));
  GANTRY_ASSERT_DONE(rig.axis().stop());
  update_while(rig, kStopping, 20);
  expect_rest(rig);
  EXPECT_NEAR(rig.axis().status().drive.position, start, 0.1 * (at_fraction(rig, 1) - at_fraction(rig, 0)));
}

inline void stop_while_homing_allows_homing_again(AxisRig& rig) {
  enable(rig);
  home(rig);
  move(rig, at_fraction(rig, 0.9));
  GANTRY_ASSERT_DONE(rig.axis().home());
  rig.advance(0.05);
  GANTRY_ASSERT_DONE(rig.axis().update());
  ASSERT_EQ(rig.axis().status().state, kHoming);
  GANTRY_ASSERT_DONE(rig.axis().stop());
  update_while(rig, kStopping, 20);
  ASSERT_EQ(rig.axis().status().state, kStandstill);
  expect_rest(rig);
  home(rig);
  move(rig, at_fraction(rig, 0.5));
}

inline void illegal_commands_disturb_nothing(AxisRig& rig) {
  be_in_mid_move(rig);
  if (testing::Test::HasFatalFailure()) return;
  EXPECT_FALSE(rig.axis().move_to(at_fraction(rig, 0.1)).has_value());
  EXPECT_FALSE(rig.axis().home().has_value());
  EXPECT_FALSE(rig.axis().enable().has_value());
  EXPECT_FALSE(rig.axis().disable().has_value());
  EXPECT_FALSE(rig.axis().reset().has_value());
  update_while(rig, kDiscreteMotion);
  EXPECT_NEAR(rig.axis().status().drive.position, at_fraction(rig, 0.95), rig.axis().limits().in_position);
  const auto outside = rig.axis().move_to(at_fraction(rig, 1.01));
  ASSERT_FALSE(outside.has_value());
  EXPECT_EQ(outside.error().kind, FaultKind::kLimit);
  expect_rest(rig);
}

inline void disabled_means_no_power_and_a_readable_status(AxisRig& rig) {
  enable(rig);
  home(rig);
  move(rig, at_fraction(rig, 0.5));
  GANTRY_ASSERT_DONE(rig.axis().disable());
  rig.advance(0.1);
  const auto status = rig.axis().update();
  GANTRY_ASSERT_DONE(status);
  EXPECT_EQ(status->state, kDisabled);
  EXPECT_FALSE(status->drive.servo_on);
  EXPECT_FALSE(status->drive.moving);
  EXPECT_TRUE(status->drive.homed);
  EXPECT_NEAR(status->drive.position, at_fraction(rig, 0.5), rig.axis().limits().in_position);
  GANTRY_ASSERT_DONE(rig.axis().enable());
  EXPECT_EQ(rig.axis().status().target, rig.axis().status().drive.position);
  move(rig, at_fraction(rig, 0.4));
}

inline void abort_stops_the_device(AxisRig& rig) {
  be_in_mid_move(rig);
  if (testing::Test::HasFatalFailure()) return;
  rig.axis().abort();
  EXPECT_EQ(rig.axis().status().state, kErrorStop);
  wait_for_rest(rig);
  const double rest = rig.axis().status().drive.position;
  EXPECT_LT(rest, at_fraction(rig, 0.9));
  expect_rest(rig);
  GANTRY_ASSERT_DONE(rig.axis().reset());
  EXPECT_EQ(rig.axis().status().state, kDisabled);
  rig.advance(0.1);
  GANTRY_ASSERT_DONE(rig.axis().update());
  EXPECT_FALSE(rig.axis().status().drive.servo_on);
  GANTRY_ASSERT_DONE(rig.axis().enable());
  EXPECT_NEAR(rig.axis().status().target, rest, rig.axis().limits().in_position);
  expect_rest(rig);
  move(rig, at_fraction(rig, 0.95));
}

/// After reset: unpowered until enabled, at rest, then usable again.
inline void expect_recovery(AxisRig& rig) {
  GANTRY_ASSERT_DONE(rig.axis().reset());
  for (int i = 0; i < 5; ++i) {
    GANTRY_ASSERT_DONE(rig.axis().update());
    ASSERT_EQ(rig.axis().status().state, kDisabled);
    ASSERT_FALSE(rig.axis().status().drive.servo_on) << "a reset must not power the motor";
    rig.advance(0.02);
  }
  GANTRY_ASSERT_DONE(rig.axis().enable());
  EXPECT_EQ(rig.axis().status().target, rig.axis().status().drive.position);
  expect_rest(rig);
  if (!rig.axis().status().drive.homed) home(rig);
  move(rig, at_fraction(rig, 0.5));
}

inline void an_alarm_stops_and_reset_recovers(AxisRig& rig) {
  be_in_mid_move(rig);
  if (testing::Test::HasFatalFailure()) return;
  if (!rig.raise_alarm()) GTEST_SKIP() << "this rig cannot raise an alarm";
  rig.advance(0.01);
  const auto failed = rig.axis().update();
  ASSERT_FALSE(failed.has_value());
  EXPECT_EQ(failed.error().kind, FaultKind::kAlarm);
  EXPECT_EQ(rig.axis().status().state, kErrorStop);
  EXPECT_TRUE(rig.axis().status().drive.alarm.has_value());
  EXPECT_FALSE(rig.axis().move_to(at_fraction(rig, 0.5)).has_value());
  wait_for_rest(rig);
  EXPECT_LT(rig.axis().status().drive.position, at_fraction(rig, 0.94));
  expect_recovery(rig);
}

inline void the_emergency_stop_is_latched(AxisRig& rig) {
  be_in_mid_move(rig);
  if (testing::Test::HasFatalFailure()) return;
  if (!rig.set_emergency_stop(true)) GTEST_SKIP() << "this rig has no emergency stop";
  rig.advance(0.01);
  ASSERT_FALSE(rig.axis().update().has_value());
  EXPECT_EQ(rig.axis().status().state, kErrorStop);
  EXPECT_TRUE(rig.axis().status().drive.emergency_stop);
  wait_for_rest(rig);

  // Still pressed: a reset does not help.
  (void)rig.axis().reset();
  EXPECT_FALSE(rig.axis().enable().has_value());
  EXPECT_EQ(rig.axis().status().state, kErrorStop);

  rig.set_emergency_stop(false);
  for (int i = 0; i < 5; ++i) {
    rig.advance(0.02);
    (void)rig.axis().update();
    EXPECT_FALSE(rig.axis().status().drive.servo_on) << "releasing the button must not power the motor";
  }
  EXPECT_EQ(rig.axis().status().state, kErrorStop);
  expect_rest(rig);
  expect_recovery(rig);
}

struct NamedCheck {
  const char* name;
  void (*run)(AxisRig&);
};

inline constexpr NamedCheck kChecks[] = {
    {"ConnectsAndNamesItself", connects_and_names_itself},
    {"StatusIsFreshInEveryState", status_is_fresh_in_every_state},
    {"EnablingMovesNothing", enabling_moves_nothing},
    {"NothingMovesBeforeHoming", nothing_moves_before_homing},
    {"HomesAsOftenAsAsked", homes_as_often_as_asked},
    {"MovesArriveAndStay", moves_arrive_and_stay},
    {"AMoveIsNotOverBeforeItBegan", a_move_is_not_over_before_it_began},
    {"TinyMovesEndToo", tiny_moves_end_too},
    {"StopInMidMoveEndsBeforeTheTarget", stop_in_mid_move_ends_before_the_target},
    {"StopRightAfterACommandWins", stop_right_after_a_command_wins},
    {"StopWhileHomingAllowsHomingAgain", stop_while_homing_allows_homing_again},
    {"IllegalCommandsDisturbNothing", illegal_commands_disturb_nothing},
    {"DisabledMeansNoPowerAndAReadableStatus", disabled_means_no_power_and_a_readable_status},
    {"AbortStopsTheDevice", abort_stops_the_device},
    {"AnAlarmStopsAndResetRecovers", an_alarm_stops_and_reset_recovers},
    {"TheEmergencyStopIsLatched", the_emergency_stop_is_latched},
};

class Fixture : public testing::Test {};

class Case final : public Fixture {
 public:
  Case(MakeAxisRig make, NamedCheck check) : make_(std::move(make)), check_(check) {}
  void TestBody() override {
    const auto rig = make_();
    check_.run(*rig);
  }

 private:
  MakeAxisRig make_;
  NamedCheck check_;
};

}  // namespace axis_conformance

/// Runs the suite on the rigs that `make` makes, as tests AxisConformance_NAME.*. Any number of test files
/// may do so:
///   const bool registered = register_axis_conformance("Simulated", [] { ... });
inline bool register_axis_conformance(const std::string& name, const MakeAxisRig& make) {
  for (const auto& check : axis_conformance::kChecks) {
    testing::RegisterTest(
        ("AxisConformance_" + name).c_str(), check.name, nullptr, nullptr, __FILE__, __LINE__,
        [make, check]() -> axis_conformance::Fixture* { return new axis_conformance::Case(make, check); });
  }
  return true;
}

}  // namespace gantry
