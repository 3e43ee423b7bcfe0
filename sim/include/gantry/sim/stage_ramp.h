#pragma once

#include <limits>

namespace gantry {

/// Position along a trapezoidal ramp from `start` to `end` that began at `begin_s`, or along a pure
/// deceleration.
struct StageRamp {
  double start = 0, end = 0, speed = 1, acceleration = 1, begin_s = 0;
  double initial_speed = 0;                                ///< Non-zero only for a pure deceleration (halt).
  double cut_s = std::numeric_limits<double>::infinity();  ///< It is left so long after its beginning.

  double duration_s() const;
  double end_s() const { return begin_s + duration_s(); }
  /// Before the beginning and after the end: as then.
  double position(double now_s) const;
  double velocity(double now_s) const;
  /// How long after the beginning `position` is reached; it must lie on the way.
  double time_at(double position) const;

  static StageRamp at_rest(double position, double begin_s);
  static StageRamp move(double from, double to, double speed, double acceleration, double begin_s);
  static StageRamp deceleration(double from, double initial_speed, double acceleration, double begin_s);

 private:
  double full_duration_s() const;
};

}  // namespace gantry
