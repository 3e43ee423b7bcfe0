#include "gantry/sim/stage.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "stage_homing.h"

namespace gantry {
namespace {

constexpr double kSettlingFrequencyHz = 25.0;
/// Amplitude of the residual oscillation when the ramp ends, as the time that it takes at full speed.
constexpr double kSettlingAmplitudeS = 2e-4;
constexpr double kBounceInterval_s = 1e-3;
constexpr double kBounceRange = 0.005;  ///< Of the travel, to both sides of a limit switch.

}  // namespace

SimulatedStage::SimulatedStage(const StageDynamics& dynamics, uint64_t seed)
    : dynamics_(dynamics), seed_(seed), random_(seed) {
  std::uniform_real_distribution<double> anywhere(0.1, 0.9);
  const double travel = dynamics_.travel_max - dynamics_.travel_min;
  ramp_ = StageRamp::at_rest(dynamics_.travel_min + anywhere(random_) * travel, 0);
  previous_ = ramp_;
  play_ = ramp_.end;
  power_on_offset_ = (anywhere(random_) - 0.5) * travel;
}

// ---- Positions, all in the encoder's coordinate as homed --------------------------------------

double SimulatedStage::commanded(double now_s) const {
  return now_s >= ramp_.begin_s ? ramp_.position(now_s) : previous_.position(now_s);
}

double SimulatedStage::actual(double now_s) const {
  if (stuck_) return stuck_at_;
  if (runaway_ramp_) return runaway_ramp_->position(now_s);
  return commanded(now_s - dynamics_.following_lag_s);
}

double SimulatedStage::actual_velocity(double now_s) const {
  if (stuck_) return 0;
  if (runaway_ramp_) return runaway_ramp_->velocity(now_s);
  const double then_s = now_s - dynamics_.following_lag_s;
  return then_s >= ramp_.begin_s ? ramp_.velocity(then_s) : previous_.velocity(then_s);
}

// The carriage follows the drive only beyond the play between them.
double SimulatedStage::carriage(double now_s) const {
  const double driven = actual(now_s), half = 0.5 * dynamics_.backlash;
  return std::clamp(play_, driven - half, driven + half);
}

double SimulatedStage::program_end_s() const {
  return program_.empty() ? ramp_.end_s() : program_.back().end_s();
}

// ---- Time goes on -----------------------------------------------------------------------------

void SimulatedStage::keep_play(double now_s) {
  play_ = carriage(now_s);
}

void SimulatedStage::advance(double now_s) {
  if (now_s >= watchdog_s_) {
    const double then_s = watchdog_s_;
    watchdog_s_ = std::numeric_limits<double>::infinity();
    advance(then_s);
    halt_at(then_s);
  }
  while (!program_.empty() && now_s >= program_.front().begin_s) {
    keep_play(program_.front().begin_s);
    previous_ = ramp_;
    ramp_ = program_.front();
    program_.erase(program_.begin());
  }
  if (homing_ends_s_ && now_s >= *homing_ends_s_) {
    homing_ends_s_.reset();
    homing_failure_ = homing_outcome_;
    homed_ = homing_outcome_ == HomingFailure::kNone && !stuck_ && !runaway_ramp_;
    if (!homed_ && homing_failure_ == HomingFailure::kNone) homing_failure_ = HomingFailure::kSwitchNotFound;
  }
}

void SimulatedStage::replace_ramp(const StageRamp& ramp, double now_s) {
  keep_play(now_s);
  previous_ = ramp_;
  ramp_ = ramp;
  program_.clear();
  homing_ends_s_.reset();
  limit_ahead_ = false;
}

// What it was doing is forgotten.
void SimulatedStage::stand(double position, double now_s) {
  replace_ramp(StageRamp::at_rest(position, now_s), now_s);
  previous_ = ramp_;
  reached_target_ = false;
}

// Where the way outwards leads over a limit switch, the drive stops there.
void SimulatedStage::stop_at_limits(double now_s) {
  const bool up = ramp_.end > ramp_.start;
  const auto& limit = up ? dynamics_.upper_limit : dynamics_.lower_limit;
  if (!limit || ramp_.end == ramp_.start) return;
  const double at = *limit - slip_;
  const double way = up ? 1 : -1;
  if (way * (ramp_.end - at) <= 0) return;
  if (way * (ramp_.start - at) >= 0) {  // Stands on it: not a step further.
    ramp_.end = ramp_.start;
    ramp_.begin_s = now_s;
  } else {
    ramp_.cut_s = ramp_.time_at(at);
    const double speed = ramp_.velocity(ramp_.begin_s + ramp_.cut_s * (1 - 1e-12));
    if (speed != 0) {
      StageRamp stop = StageRamp::deceleration(at, speed, dynamics_.max_acceleration, ramp_.end_s());
      program_.push_back(stop);
    }
  }
  limit_ahead_ = true;
  reached_target_ = false;
}

// ---- Commands ---------------------------------------------------------------------------------

// The brake holds the carriage where it is.
void SimulatedStage::drop_torque(double now_s) {
  if (!servo_on_) return;
  const double here = actual(now_s);
  runaway_ramp_.reset();
  stand(here, now_s);
  servo_on_ = false;
}

void SimulatedStage::lose_power(double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  drop_torque(now_s);
  if (dynamics_.homing == HomingMethod::kStored || !homed_) return;
  homed_ = false;
  const double travel = dynamics_.travel_max - dynamics_.travel_min;
  power_on_offset_ = std::uniform_real_distribution<double>(-0.4, 0.4)(random_) * travel;
}

void SimulatedStage::set_servo(bool on, double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  if (!on) drop_torque(now_s);
  const bool powered_now = on && !servo_on_;
  servo_on_ = on;
  if (powered_now && stuck_) stand(stuck_at_, now_s);
  if (powered_now && runaway_ != 0) {
    const double end = (runaway_ > 0 ? dynamics_.travel_max : dynamics_.travel_min) - slip_;
    runaway_ramp_ =
        StageRamp::move(commanded(now_s), end, dynamics_.max_speed, dynamics_.max_acceleration, now_s);
  }
}

void SimulatedStage::begin_ramp(double target, double speed, double acceleration, double now_s) {
  const double here = commanded(now_s);
  const double end = std::clamp(target, dynamics_.travel_min - slip_, dynamics_.travel_max - slip_);
  replace_ramp(StageRamp::move(here, end, std::clamp(speed, 1e-9, dynamics_.max_speed),
                               std::clamp(acceleration, 1e-9, dynamics_.max_acceleration), now_s),
               now_s);
  previous_rest_error_ = rest_error_;
  rest_error_ = std::normal_distribution<double>(0.0, 1.0)(random_) * dynamics_.repeatability_sigma;
}

bool SimulatedStage::start_homing(double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  if (!servo_on_) return false;
  // The switches are on the carriage: from now on its position counts, and the slip shows in the encoder.
  if (homed_) power_on_offset_ = 0;
  power_on_offset_ -= slip_;
  const double here = commanded(now_s) + slip_;
  play_ += slip_;
  slip_ = 0;
  begin_ramp(here, 1, 1, now_s);  // Draws the rest error.
  HomingProgram program = plan_homing(dynamics_, !dead_home_switch_, here, now_s);
  ramp_ = program.ramps.front();
  previous_ = StageRamp::at_rest(here, now_s);
  program_.assign(program.ramps.begin() + 1, program.ramps.end());
  homing_outcome_ = program.outcome;
  homing_failure_ = HomingFailure::kNone;
  homed_ = false;
  reached_target_ = false;
  limit_ahead_ = program.outcome == HomingFailure::kLimitSwitch;
  homing_ends_s_ = program_end_s() + dynamics_.following_lag_s + dynamics_.settling_time_s;
  return true;
}

bool SimulatedStage::start_move(double target, double speed, double acceleration, double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  if (!servo_on_) return false;
  begin_ramp(target, speed, acceleration, now_s);
  reached_target_ = true;
  stop_at_limits(now_s);
  return true;
}

void SimulatedStage::halt_at(double now_s) {
  const bool under_way = now_s < program_end_s();
  if (homing_ends_s_) homing_ends_s_.reset();
  if (!under_way) return;
  const double speed = ramp_.velocity(now_s);
  if (speed == 0) return stand(commanded(now_s), now_s);
  const bool at_limit = limit_ahead_ && program_.empty() && ramp_.initial_speed != 0;
  replace_ramp(StageRamp::deceleration(commanded(now_s), speed, dynamics_.max_acceleration, now_s), now_s);
  ramp_.end = std::clamp(ramp_.end, dynamics_.travel_min - slip_, dynamics_.travel_max - slip_);
  if (std::abs(ramp_.end - ramp_.start) < 0.5 * speed * speed / dynamics_.max_acceleration)
    ramp_.cut_s = ramp_.time_at(ramp_.end);  // The hard stop is nearer.
  limit_ahead_ = at_limit;
  reached_target_ = false;
}

void SimulatedStage::halt(double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  halt_at(now_s);
}

void SimulatedStage::halt_unless_kept_alive(double until_s, double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  watchdog_s_ = until_s;
}

// ---- Faults -----------------------------------------------------------------------------------

void SimulatedStage::inject(StageFault fault, double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  switch (fault) {
    case StageFault::kStuck:
      if (stuck_) break;
      keep_play(now_s);
      stuck_at_ = actual(now_s);
      stuck_ = true;
      break;
    case StageFault::kRunawayUp:
    case StageFault::kRunawayDown: {
      runaway_ = fault == StageFault::kRunawayUp ? 1 : -1;
      keep_play(now_s);
      const double end = (runaway_ > 0 ? dynamics_.travel_max : dynamics_.travel_min) - slip_;
      if (servo_on_)
        runaway_ramp_ =
            StageRamp::move(actual(now_s), end, dynamics_.max_speed, dynamics_.max_acceleration, now_s);
      break;
    }
    case StageFault::kDeadHomeSwitch:
      dead_home_switch_ = true;
      break;
    case StageFault::kLimitBounce:
      limit_bounce_ = true;
      break;
  }
}

void SimulatedStage::clear(StageFault fault, double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  switch (fault) {
    case StageFault::kStuck:
      if (!stuck_) break;
      stuck_ = false;
      if (servo_on_ && !runaway_ramp_) {
        const double wanted = program_.empty() ? ramp_.end : program_.back().end;
        const bool was_move = reached_target_;
        replace_ramp(
            StageRamp::move(stuck_at_, wanted, dynamics_.max_speed, dynamics_.max_acceleration, now_s),
            now_s);
        previous_ = StageRamp::at_rest(stuck_at_, now_s);
        reached_target_ = was_move;
      } else {
        stand(stuck_at_, now_s);
      }
      break;
    case StageFault::kRunawayUp:
    case StageFault::kRunawayDown: {
      const double here = actual(now_s), speed = actual_velocity(now_s);
      runaway_ = 0;
      if (!runaway_ramp_) break;
      runaway_ramp_.reset();
      stand(here, now_s);
      if (speed != 0) {
        ramp_ = StageRamp::deceleration(here, speed, dynamics_.max_acceleration, now_s);
        ramp_.end = std::clamp(ramp_.end, dynamics_.travel_min - slip_, dynamics_.travel_max - slip_);
        ramp_.cut_s = ramp_.time_at(ramp_.end);
      }
      break;
    }
    case StageFault::kDeadHomeSwitch:
      dead_home_switch_ = false;
      break;
    case StageFault::kLimitBounce:
      limit_bounce_ = false;
      break;
  }
}

void SimulatedStage::slip(double distance, double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  slip_ += distance;
}

// ---- What shows -------------------------------------------------------------------------------

bool SimulatedStage::bounces(double now_s) const {
  uint64_t x = seed_ ^ static_cast<uint64_t>(now_s / kBounceInterval_s) * 0x9E3779B97F4A7C15ull;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;  // splitmix64
  return ((x ^ (x >> 27)) >> 11) & 1;
}

StageState SimulatedStage::observe(double now_s) {
  std::lock_guard lock(mutex_);
  advance(now_s);
  StageState state;
  const double lag_s = dynamics_.following_lag_s;
  const double end_s = program_end_s() + lag_s;
  double position = actual(now_s);
  state.velocity = actual_velocity(now_s);
  state.following_error = commanded(now_s) - position;
  const double settling_s = now_s - end_s;
  const bool travelled = ramp_.end != ramp_.start;
  const bool settling =
      travelled && program_.empty() && settling_s >= 0 && settling_s < dynamics_.settling_time_s;
  if (settling && !stuck_ && !runaway_ramp_) {
    const double decay = std::exp(-6.0 * settling_s / dynamics_.settling_time_s);
    position += ramp_.speed * kSettlingAmplitudeS * decay *
                std::sin(2 * std::numbers::pi * kSettlingFrequencyHz * settling_s);
  }
  state.moving = settling_s < 0 || settling || state.velocity != 0;
  state.servo_on = servo_on_;
  state.homed = homed_;
  state.homing_failure = homing_failure_;
  const bool follows = std::abs(state.following_error) <= 5 * dynamics_.encoder_resolution + 1e-9;
  state.in_position = servo_on_ && reached_target_ && !state.moving && follows;
  state.stopped_by_limit = limit_ahead_ && !state.moving;
  const double progress =
      travelled ? std::clamp((commanded(now_s - lag_s) - ramp_.start) / (ramp_.end - ramp_.start), 0.0, 1.0)
                : 1.0;
  const double oscillation = position - actual(now_s);
  state.true_position = carriage(now_s) + oscillation + slip_ + previous_rest_error_ +
                        progress * (rest_error_ - previous_rest_error_);
  const double reported = position + (state.homed ? 0.0 : power_on_offset_);
  const double step = dynamics_.encoder_resolution;
  state.encoder_position = step > 0 ? std::round(reported / step) * step : reported;

  const double place = position + slip_;
  state.home_switch = !dead_home_switch_ && on_home_switch(dynamics_, place);
  state.lower_limit = dynamics_.lower_limit && place <= *dynamics_.lower_limit;
  state.upper_limit = dynamics_.upper_limit && place >= *dynamics_.upper_limit;
  const double range = kBounceRange * (dynamics_.travel_max - dynamics_.travel_min);
  if (limit_bounce_ && dynamics_.lower_limit && std::abs(place - *dynamics_.lower_limit) < range)
    state.lower_limit = bounces(now_s);
  if (limit_bounce_ && dynamics_.upper_limit && std::abs(place - *dynamics_.upper_limit) < range)
    state.upper_limit = bounces(now_s);
  return state;
}

}  // namespace gantry
