#include "gantry/sim/stage_ramp.h"

#include <algorithm>
#include <cmath>

namespace gantry {

StageRamp StageRamp::at_rest(double position, double begin_s) {
  StageRamp ramp;
  ramp.start = ramp.end = position;
  ramp.begin_s = begin_s;
  return ramp;
}

StageRamp StageRamp::move(double from, double to, double speed, double acceleration, double begin_s) {
  StageRamp ramp;
  ramp.start = from;
  ramp.end = to;
  ramp.speed = speed;
  ramp.acceleration = acceleration;
  ramp.begin_s = begin_s;
  return ramp;
}

StageRamp StageRamp::deceleration(double from, double initial_speed, double acceleration, double begin_s) {
  StageRamp ramp;
  ramp.start = from;
  ramp.initial_speed = initial_speed;
  ramp.acceleration = acceleration;
  ramp.begin_s = begin_s;
  ramp.end = from + std::copysign(0.5 * initial_speed * initial_speed / acceleration, initial_speed);
  return ramp;
}

double StageRamp::full_duration_s() const {
  if (initial_speed != 0) return std::abs(initial_speed) / acceleration;
  const double distance = std::abs(end - start);
  const double ramp_distance = speed * speed / acceleration;
  if (distance < ramp_distance) return 2.0 * std::sqrt(distance / acceleration);
  return distance / speed + speed / acceleration;
}

double StageRamp::duration_s() const {
  return std::min(cut_s, full_duration_s());
}

double StageRamp::position(double now_s) const {
  const double t = std::clamp(now_s - begin_s, 0.0, duration_s());
  if (initial_speed != 0)
    return start + initial_speed * t - std::copysign(0.5 * acceleration * t * t, initial_speed);
  const double total = full_duration_s();
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

double StageRamp::velocity(double now_s) const {
  const double total = full_duration_s();
  const double t = now_s - begin_s;
  if (t <= 0 || t >= duration_s()) return 0;
  if (initial_speed != 0) return std::copysign(std::abs(initial_speed) - acceleration * t, initial_speed);
  const double ramp_s = std::min(speed / acceleration, total / 2);
  return std::copysign(acceleration * std::min({t, ramp_s, total - t}), end - start);
}

double StageRamp::time_at(double wanted) const {
  double low = 0, high = full_duration_s();
  for (int i = 0; i < 80; ++i) {  // monotone: halved until the numbers end
    const double middle = 0.5 * (low + high);
    const bool passed = std::abs(position(begin_s + middle) - start) >= std::abs(wanted - start);
    (passed ? high : low) = middle;
  }
  return high;
}

}  // namespace gantry
