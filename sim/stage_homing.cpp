#include "stage_homing.h"

#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

double edge_of(const StageDynamics& d) {
  // The first index pulse after leaving the switch is the one at zero.
  return d.homing == HomingMethod::kSwitchAndIndex ? d.search_direction * 0.5 * d.index_pitch : 0.0;
}

/// Appends ramps, each from where the one before ends.
class Route {
 public:
  Route(const StageDynamics& dynamics, double from, double begin_s)
      : dynamics_(dynamics), here_(from), now_s_(begin_s) {}

  void go_to(double target, double speed) {
    add(StageRamp::move(here_, target, speed, dynamics_.max_acceleration, now_s_));
  }
  /// At `speed` until a switch at `edge` closes, then to rest: a trapezoid whose deceleration begins there.
  void go_beyond(double edge, double speed) {
    const double way = edge - here_;
    const double braking = std::min(std::abs(way), 0.5 * speed * speed / dynamics_.max_acceleration);
    go_to(std::clamp(edge + std::copysign(braking, way), dynamics_.travel_min, dynamics_.travel_max), speed);
  }
  std::vector<StageRamp> take() { return std::move(ramps_); }

 private:
  void add(const StageRamp& ramp) {
    ramps_.push_back(ramp);
    here_ = ramp.end;
    now_s_ = ramp.end_s();
  }

  const StageDynamics& dynamics_;
  double here_, now_s_;
  std::vector<StageRamp> ramps_;
};

}  // namespace

bool on_home_switch(const StageDynamics& d, double position) {
  return d.homing != HomingMethod::kStored && d.search_direction * (position - edge_of(d)) >= 0;
}

HomingProgram plan_homing(const StageDynamics& d, bool switch_works, double from, double begin_s) {
  HomingProgram program;
  Route route(d, from, begin_s);
  const double creep = d.creep_speed > 0 ? d.creep_speed : 0.1 * d.homing_speed;
  const double edge = edge_of(d);
  if (d.homing == HomingMethod::kStored) {
    route.go_to(0, d.homing_speed);
  } else if (!switch_works) {
    const auto& limit = d.search_direction < 0 ? d.lower_limit : d.upper_limit;
    const bool stops_at_limit = limit && d.search_direction * (*limit - from) > 0;
    if (stops_at_limit)
      route.go_beyond(*limit, d.homing_speed);
    else
      route.go_to(d.search_direction < 0 ? d.travel_min : d.travel_max, d.homing_speed);
    program.outcome = stops_at_limit ? HomingFailure::kLimitSwitch : HomingFailure::kSwitchNotFound;
  } else {
    if (!on_home_switch(d, from)) route.go_beyond(edge, d.homing_speed);
    if (d.homing == HomingMethod::kSwitch) route.go_to(edge - d.search_direction * d.back_off, creep);
    route.go_to(0, creep);
  }
  program.ramps = route.take();
  return program;
}

}  // namespace gantry
