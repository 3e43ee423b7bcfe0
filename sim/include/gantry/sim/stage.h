#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <random>

namespace gantry {

/// Physical facts of one simulated stage, in axis units (mm or rad).
struct StageDynamics {
  double travel_min = 0;  ///< Hard stops, measured from the home position.
  double travel_max = 0;
  double max_speed = 0;
  double max_acceleration = 0;
  double homing_speed = 0;
  double encoder_resolution = 0;  ///< The encoder reports multiples of this.
  double repeatability_sigma =
      0;  ///< The true rest position differs from the encoder's by N(0, sigma), drawn per move.
  double settling_time_s = 0.15;  ///< From the end of the ramp until it stands still within the resolution.
};

/// What can be known of a stage at one instant.
struct StageState {
  double encoder_position = 0;  ///< Before homing: with an unknown offset.
  double true_position = 0;     ///< Where the carriage really is, measured from home.
  double velocity = 0;
  bool servo_on = false;
  bool homed = false;
  bool moving = false;       ///< Includes settling.
  bool in_position = false;  ///< The last commanded move has ended at its target.
};

/// Acceleration-limited motion of one stage as a function of time: commands carry the time at which
/// they arrive, observe() tells the state at any later time. Nothing here knows of a protocol. The
/// physics: trapezoidal ramps within the stage's own maxima, a damped residual oscillation while
/// settling, hard stops that clip the travel, a home position that is unknown at power-on. Thread-safe.
class SimulatedStage {
 public:
  SimulatedStage(const StageDynamics& dynamics, uint64_t seed);

  void set_servo(bool on, double now_s);
  /// False (and nothing happens) when the servo is off.
  bool start_homing(double now_s);
  /// False (and nothing happens) when the servo is off. A move during motion replaces it, starting
  /// from rest at the present position. Speed and acceleration are clipped to the stage's maxima.
  bool start_move(double target, double speed, double acceleration, double now_s);
  /// Decelerates to standstill.
  void halt(double now_s);
  StageState observe(double now_s) const;

  const StageDynamics& dynamics() const { return dynamics_; }

 private:
  /// Position along a trapezoidal ramp from `start` to `end` that began at `begin_s`.
  struct Ramp {
    double start = 0, end = 0, speed = 1, acceleration = 1, begin_s = 0;
    double initial_speed = 0;  ///< Non-zero only for a pure deceleration (halt).
    double duration_s() const;
    double position(double t_s) const;
    double velocity(double t_s) const;
  };
  StageState observe_locked(double now_s) const;
  void begin_ramp(double target, double speed, double acceleration, double now_s);

  StageDynamics dynamics_;
  mutable std::mutex mutex_;
  std::mt19937_64 random_;
  Ramp ramp_;
  double power_on_offset_;  ///< Encoder minus true position until homed.
  double rest_error_ = 0;   ///< True minus encoder at the end of the present ramp.
  double previous_rest_error_ = 0;
  bool servo_on_ = false;
  std::optional<double> homing_ends_s_;
  bool homed_ = false;
  bool reached_target_ =
      false;  ///< The present ramp was a move (not a halt) and counts as in position when it ends.
};

}  // namespace gantry
