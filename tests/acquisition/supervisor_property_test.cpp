// Random interleavings of commands, faults and cycles, and what must hold after each cycle whatever they
// are. The truth is asked of the simulated mechanics, not of the drives' answers.

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <random>

#include "acquisition/motion_rig.h"

namespace gantry {
namespace {

using enum AxisState;

constexpr double kPeriod_s = 0.01;
/// Noticing (following error 50 ms, silence one cycle), braking by the drive's own deceleration, then
/// torque off after the patience of a halt that does not help; a silent drive halts itself after 0.3 s.
constexpr double kStopDeadline_s = 0.9;
constexpr double kDriveTimeout_s = 0.3;

class Interleaving {
 public:
  explicit Interleaving(uint64_t seed) : rig_(seed), random_(seed) {
    for (auto* drive : rig_.drives) (void)drive->set_communication_timeout(kDriveTimeout_s);
    for (size_t i = 0; i < MotionRig::kAxes; ++i) remember(i);
  }

  void run(int cycles) {
    for (int i = 0; i < cycles && !testing::Test::HasFailure(); ++i) {
      if (chance(0.06)) command();
      if (chance(0.01)) begin_trouble();
      if (chance(0.02)) end_trouble();
      if (chance(0.7)) rig_.supervisor->keep_alive(rig_.clock.now_s());
      rig_.step();
      check();
    }
  }

  int errors = 0, moves = 0,
      homings = 0;  ///< How much happened: a test in which nothing does proves nothing.

 private:
  bool chance(double p) { return std::uniform_real_distribution<double>(0, 1)(random_) < p; }
  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  size_t axis() { return std::uniform_int_distribution<size_t>(0, MotionRig::kAxes - 1)(random_); }

  void command() {
    MotionRequest request;
    request.axes = std::uniform_int_distribution<AxisSet>(1, 7)(random_);
    for (auto& move : request.moves) move = {between(-60, 360), between(1, 200), between(100, 900)};
    if (chance(0.5))
      for (auto& move : request.moves) move.target = between(0, 300);
    const AxisTrigger commands[] = {AxisTrigger::kEnable, AxisTrigger::kEnable, AxisTrigger::kHome,
                                    AxisTrigger::kHome,   AxisTrigger::kMove,   AxisTrigger::kMove,
                                    AxisTrigger::kMove,   AxisTrigger::kJog,    AxisTrigger::kJog,
                                    AxisTrigger::kReset,  AxisTrigger::kReset,  AxisTrigger::kStop,
                                    AxisTrigger::kDisable};
    request.command = commands[std::uniform_int_distribution<size_t>(0, std::size(commands) - 1)(random_)];
    if (request.command == AxisTrigger::kEnable && chance(0.8)) request.axes = 7;
    request.hold_to_run = chance(0.5);
    if (chance(0.05)) rig_.supervisor->stop(chance(0.5));
    (void)rig_.supervisor->request(request);
  }

  void begin_trouble() {
    const double now_s = rig_.clock.now_s();
    const size_t i = axis();
    switch (std::uniform_int_distribution<int>(0, 6)(random_)) {
      case 0:
        rig_.world->stage(i).inject(StageFault::kStuck, now_s);
        break;
      case 1:
        rig_.world->stage(i).inject(chance(0.5) ? StageFault::kRunawayUp : StageFault::kRunawayDown, now_s);
        runs_away_[i] = true;
        break;
      case 2:
        rig_.world->stage(i).inject(StageFault::kDeadHomeSwitch, now_s);
        break;
      case 3:
        rig_.drives[i]->silent = true;
        break;
      case 4:
        rig_.world->stage(i).set_servo(false, now_s);
        break;
      case 5:
        rig_.permit.demanded = chance(0.5) ? StopCategory::kCategory0 : StopCategory::kCategory1;
        break;
      default:
        rig_.clock.sleep_s(between(0.1, 1));  // Nobody turns the loop: readings grow old.
    }
    trouble_s_ = rig_.clock.now_s();
    disturbed_[i] = true;
    broken_[i] = true;
  }

  void end_trouble() {
    const double now_s = rig_.clock.now_s();
    trouble_s_ = now_s;
    rig_.permit.demanded = StopCategory::kNone;
    for (size_t i = 0; i < MotionRig::kAxes; ++i) {
      runs_away_[i] = false;
      broken_[i] = false;
      for (const StageFault fault : {StageFault::kStuck, StageFault::kRunawayUp, StageFault::kDeadHomeSwitch})
        rig_.world->stage(i).clear(fault, now_s);
      rig_.drives[i]->silent = false;
    }
  }

  void remember(size_t i) { rest_[i] = rig_.truth(i).true_position; }

  void check() {
    const double now_s = rig_.clock.now_s();
    const SupervisorStatus status = rig_.supervisor->status();
    const AxisLimits limits = rig_limits();
    bool any_error = false, any_powered = false;
    for (size_t i = 0; i < MotionRig::kAxes; ++i) {
      any_error = any_error || status.axes[i].state == kErrorStop;
      any_powered = any_powered || is_powered(status.axes[i].state);
    }
    EXPECT_FALSE(any_error && any_powered) << "one in error, another still at work";
    if (any_error && !error_since_s_) {
      error_since_s_ = now_s;
      ++errors;
    }
    if (!any_error) error_since_s_.reset();

    for (size_t i = 0; i < MotionRig::kAxes; ++i) {
      const StageState truth = rig_.truth(i);
      const AxisState state = status.axes[i].state;
      const bool moves_now = std::abs(truth.velocity) > 1e-9;
      if (state == kDiscreteMotion && was_[i] == kStandstill) ++moves;
      if (state == kHoming && was_[i] != kHoming) ++homings;

      // Everything stands within the deadline after an error, or after what happened since. Against a runaway
      // that cannot be told to drop its torque no software helps.
      const bool beyond_help = runs_away_[i] && rig_.drives[i]->silent;
      if (error_since_s_ && now_s > std::max(*error_since_s_, trouble_s_) + kStopDeadline_s && !beyond_help) {
        EXPECT_FALSE(moves_now) << "axis " << i << " still moves after an error";
      }
      // What stands still or has no power does not move. Mechanics that run away, or were let go, may until
      // they are noticed.
      if (beyond_help) quiet_since_s_[i] = now_s;
      const bool quiet = (state == kStandstill && was_[i] == kStandstill) || state == kDisabled;
      if (!quiet || !moves_now) quiet_since_s_[i] = now_s;
      EXPECT_LE(now_s - quiet_since_s_[i], kStopDeadline_s) << "axis " << i << " moves on its own";

      // Un-homed, only homing and slow jogs.
      if (!truth.homed && state == kDiscreteMotion && !disturbed_[i]) {
        EXPECT_LE(std::abs(truth.velocity), limits.unhomed_jogging_speed() * 1.0001);
      }

      // Homed, never outside the soft limits by more than it takes to notice and to stop.
      if (truth.homed && !status.axes[i].pending) {
        const double notice_s = limits.following_error_time_s + 3 * kPeriod_s;
        const double beyond =
            std::max(limits.lower - truth.encoder_position, truth.encoder_position - limits.upper);
        const double stray = disturbed_[i] ? 30 : limits.speed * notice_s + limits.braking_distance();
        EXPECT_LE(beyond, stray) << "axis " << i << " at " << truth.encoder_position;
        // Undisturbed not at all.
        if (!disturbed_[i]) {
          EXPECT_LE(beyond, 3 * limits.in_position + 0.05) << "axis " << i;
        }
      }

      // No power, and no motion on its return: the axis is where it was when it was enabled.
      const bool just_enabled = state == kStandstill && was_[i] == kDisabled;
      if (just_enabled && !disturbed_[i]) {
        EXPECT_NEAR(truth.true_position, rest_[i], 0.05) << "axis " << i << " jumped at enable";
      }
      if (state == kDisabled) remember(i);
      was_[i] = state;
      // Undisturbed again once it was at rest without power, its mechanics whole, and not far out.
      const bool inside = !truth.homed || (truth.encoder_position >= limits.lower - 0.1 &&
                                           truth.encoder_position <= limits.upper + 0.1);
      if (state == kDisabled && !moves_now && !broken_[i] && inside) disturbed_[i] = false;
    }
  }

  MotionRig rig_;
  std::mt19937_64 random_;
  std::optional<double> error_since_s_;
  double trouble_s_ = 0;  ///< When something last began or ended.
  bool runs_away_[MotionRig::kAxes] = {}, broken_[MotionRig::kAxes] = {};
  double quiet_since_s_[MotionRig::kAxes] = {};
  double rest_[MotionRig::kAxes] = {};
  bool disturbed_[MotionRig::kAxes] = {};
  AxisState was_[MotionRig::kAxes] = {};
};

TEST(SupervisorProperties, HoldInRandomInterleavings) {
  int errors = 0, moves = 0, homings = 0;
  for (uint64_t seed = 1; seed <= 150 && !HasFailure(); ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Interleaving interleaving(seed);
    interleaving.run(1500);
    errors += interleaving.errors;
    moves += interleaving.moves;
    homings += interleaving.homings;
  }
  EXPECT_GT(errors, 300);
  EXPECT_GT(moves, 300);
  EXPECT_GT(homings, 300);
}

}  // namespace
}  // namespace gantry
