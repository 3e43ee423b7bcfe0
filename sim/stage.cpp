#include "gantry/sim/stage.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gantry {
namespace {

constexpr double kSettlingFrequencyHz = 25.0;
/// Amplitude of the residual oscillation when the ramp ends, as the time that it takes at full speed.
constexpr double kSettlingAmplitudeS = 2e-4;

}  // namespace

double SimulatedStage::Ramp::duration_s() const {
  if (initial_speed != 0) return std::abs(initial_speed) / acceleration;
  const double distance = std::abs(end - start);
  const double ramp_distance = speed * speed / acceleration;
  if (distance < ramp_distance) return 2.0 * std::sqrt(distance / acceleration);
  return distance / speed + speed / acceleration;
}

double SimulatedStage::Ramp::position(double t_s) const {
  const double t = std::clamp(t_s - begin_s, 0.0, duration_s());
  if (initial_speed != 0)
    return start + initial_speed * t - std::copysign(0.5 * acceleration * t * t, initial_speed);
  const double total = duration_s();
  const double distance = std::abs(end - start);
  const double ramp_s = std::min(speed / acceleration, total / 2);
  double s = 0;
  if (t < ramp_s) {
    s = 0.5 * acceleration * t * t;
  } else if (t < total - ramp_s) {
    s = 0.5 * acceleration * ramp_s * ramp_s + acceleration * ramp_s * (t - ramp_s);
  } else {
    s = distance - 0.5 * acceleration * (total - t) * (total - t);
  }
  return start + std::copysign(s, end - start);
}

double SimulatedStage::Ramp::velocity(double t_s) const {
  const double total = duration_s();
  const double t = t_s - begin_s;
  if (t <= 0 || t >= total) return 0;
  if (initial_speed != 0) return std::copysign(std::abs(initial_speed) - acceleration * t, initial_speed);
  const double ramp_s = std::min(speed / acceleration, total / 2);
  return std::copysign(acceleration * std::min({t, ramp_s, total - t}), end - start);
}

SimulatedStage::SimulatedStage(const StageDynamics& dynamics, uint64_t seed)
    : dynamics_(dynamics), random_(seed) {
  std::uniform_real_distribution<double> anywhere(0.1, 0.9);
  const double travel = dynamics_.travel_max - dynamics_.travel_min;
  ramp_.start = ramp_.end = dynamics_.travel_min + anywhere(random_) * travel;
  power_on_offset_ = (anywhere(random_) - 0.5) * travel;
}

void SimulatedStage::set_servo(bool on, double now_s) {
  std::lock_guard lock(mutex_);
  if (homing_ends_s_ && now_s >= *homing_ends_s_) homed_ = true;
  if (!on && servo_on_) {
    // Without power the carriage coasts to rest almost at once; what it was doing is forgotten.
    const double here = ramp_.position(now_s);
    ramp_ = Ramp{};
    ramp_.start = ramp_.end = here;
    ramp_.begin_s = now_s;
    reached_target_ = false;
    homing_ends_s_.reset();
  }
  servo_on_ = on;
}

void SimulatedStage::begin_ramp(double target, double speed, double acceleration, double now_s) {
  const double here = ramp_.position(now_s);
  ramp_ = Ramp{};
  ramp_.start = here;
  ramp_.end = std::clamp(target, dynamics_.travel_min, dynamics_.travel_max);
  ramp_.speed = std::clamp(speed, 1e-9, dynamics_.max_speed);
  ramp_.acceleration = std::clamp(acceleration, 1e-9, dynamics_.max_acceleration);
  ramp_.begin_s = now_s;
  previous_rest_error_ = rest_error_;
  rest_error_ = std::normal_distribution<double>(0.0, 1.0)(random_) * dynamics_.repeatability_sigma;
}

bool SimulatedStage::start_homing(double now_s) {
  std::lock_guard lock(mutex_);
  if (!servo_on_) return false;
  homed_ = false;
  reached_target_ = false;
  begin_ramp(0.0, dynamics_.homing_speed, dynamics_.max_acceleration, now_s);
  homing_ends_s_ = now_s + ramp_.duration_s() + dynamics_.settling_time_s;
  return true;
}

bool SimulatedStage::start_move(double target, double speed, double acceleration, double now_s) {
  std::lock_guard lock(mutex_);
  if (!servo_on_) return false;
  if (homing_ends_s_ && now_s >= *homing_ends_s_) homed_ = true;
  homing_ends_s_.reset();
  begin_ramp(target, speed, acceleration, now_s);
  reached_target_ = true;
  return true;
}

void SimulatedStage::halt(double now_s) {
  std::lock_guard lock(mutex_);
  if (homing_ends_s_ && now_s >= *homing_ends_s_) homed_ = true;
  const bool interrupted_homing = homing_ends_s_ && now_s < *homing_ends_s_;
  if (interrupted_homing) homing_ends_s_.reset();
  if (now_s >= ramp_.begin_s + ramp_.duration_s()) return;
  const double speed = ramp_.velocity(now_s);
  const double here = ramp_.position(now_s);
  Ramp stop;
  stop.start = here;
  stop.initial_speed = speed;
  stop.acceleration = dynamics_.max_acceleration;
  stop.begin_s = now_s;
  stop.end = here + std::copysign(0.5 * speed * speed / stop.acceleration, speed);
  ramp_ = stop;
  reached_target_ = false;
}

StageState SimulatedStage::observe(double now_s) const {
  std::lock_guard lock(mutex_);
  return observe_locked(now_s);
}

StageState SimulatedStage::observe_locked(double now_s) const {
  StageState state;
  const double end_s = ramp_.begin_s + ramp_.duration_s();
  double position = ramp_.position(now_s);
  state.velocity = ramp_.velocity(now_s);
  const double settling_s = now_s - end_s;
  const bool travelled = ramp_.end != ramp_.start;
  const bool settling = travelled && settling_s >= 0 && settling_s < dynamics_.settling_time_s;
  if (settling) {
    const double decay = std::exp(-6.0 * settling_s / dynamics_.settling_time_s);
    position += ramp_.speed * kSettlingAmplitudeS * decay *
                std::sin(2 * std::numbers::pi * kSettlingFrequencyHz * settling_s);
  }
  state.moving = settling_s < 0 || settling;
  state.servo_on = servo_on_;
  state.homed = homed_ || (homing_ends_s_ && now_s >= *homing_ends_s_);
  state.in_position = servo_on_ && reached_target_ && !state.moving;
  const double progress =
      travelled ? std::clamp((ramp_.position(now_s) - ramp_.start) / (ramp_.end - ramp_.start), 0.0, 1.0)
                : 1.0;
  state.true_position = position + previous_rest_error_ + progress * (rest_error_ - previous_rest_error_);
  const double reported = position + (state.homed ? 0.0 : power_on_offset_);
  const double step = dynamics_.encoder_resolution;
  state.encoder_position = step > 0 ? std::round(reported / step) * step : reported;
  return state;
}

}  // namespace gantry
