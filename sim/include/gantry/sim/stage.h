#pragma once

#include <cstdint>
#include <limits>
#include <mutex>
#include <optional>
#include <random>
#include <vector>

#include "gantry/sim/stage_ramp.h"

namespace gantry {

/// How a stage finds its home position, which is where its coordinate is zero.
enum class HomingMethod {
  kStored,         ///< It knows the way: an absolute encoder, a position kept by the drive.
  kSwitch,         ///< Search the home switch, back off, approach its edge at creep speed: the edge is home.
  kSwitchAndIndex  ///< Search the switch, back off at creep speed to the first index pulse beyond its edge.
};

/// Physical facts of one simulated stage, in axis units (mm or rad).
struct StageDynamics {
  double travel_min = 0;  ///< Hard stops, measured from the home position.
  double travel_max = 0;
  double max_speed = 0;
  double max_acceleration = 0;
  double homing_speed = 0;        ///< Of the search.
  double encoder_resolution = 0;  ///< The encoder reports multiples of this.
  double repeatability_sigma =
      0;  ///< The true rest position differs from the encoder's by N(0, sigma), drawn per move.
  double settling_time_s = 0.15;  ///< From the end of the ramp until it stands still within the resolution.

  HomingMethod homing = HomingMethod::kStored;
  int search_direction = -1;  ///< The home switch is active from its edge on in this direction.
  double creep_speed = 0;     ///< 0: a tenth of the homing speed.
  double back_off = 0;        ///< From the switch's edge before the final approach (kSwitch).
  double index_pitch = 0;     ///< Way between two index pulses; the edge lies half a pitch before home.
  /// Limit switches, active from there on outwards. On the way outwards the drive stops at one.
  std::optional<double> lower_limit = std::nullopt, upper_limit = std::nullopt;
  double following_lag_s = 0;  ///< The carriage is where the command was so long ago: lag ~ velocity.
  double backlash = 0;         ///< Play between the encoder and the carriage.
};

enum class HomingFailure { kNone, kSwitchNotFound, kLimitSwitch };

/// What can be known of a stage at one instant.
struct StageState {
  double encoder_position = 0;  ///< Before homing: with an unknown offset.
  double true_position = 0;     ///< Where the carriage really is, measured from home.
  double velocity = 0;
  bool servo_on = false;
  bool homed = false;
  bool moving = false;         ///< Includes settling.
  bool in_position = false;    ///< The last commanded move has ended at its target.
  double following_error = 0;  ///< Commanded minus actual position.
  bool home_switch = false, lower_limit = false, upper_limit = false;
  HomingFailure homing_failure = HomingFailure::kNone;  ///< Of the last homing.
  bool stopped_by_limit = false;                        ///< A limit switch ended the last motion.
};

/// Faults of the mechanics. Each stays until it is cleared; clearing repairs the mechanics, not what the
/// drive has made of it.
enum class StageFault {
  kStuck,      ///< The carriage does not move; when released it goes where the command is by now.
  kRunawayUp,  ///< Under power the carriage runs to the upper end, whatever is commanded.
  kRunawayDown,
  kDeadHomeSwitch,  ///< Never active.
  kLimitBounce      ///< Near the limit switches their readings are random (by seed and time).
};

/// Acceleration-limited motion of one stage as a function of time: commands carry the time at which
/// they arrive, observe() tells the state at any later time. Nothing here knows of a protocol. The
/// physics: trapezoidal ramps within the stage's own maxima, a damped residual oscillation while
/// settling, lag, play, hard stops that clip the travel, switches, a home position that is unknown at
/// power-on. Thread-safe.
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
  /// No supply: no torque, and an encoder that counts from somewhere else afterwards.
  void lose_power(double now_s);
  /// Halts by itself at `until_s` unless called again before: a drive's communication time-out.
  /// Infinity: no more.
  void halt_unless_kept_alive(double until_s, double now_s);
  StageState observe(double now_s);

  void inject(StageFault fault, double now_s);
  void clear(StageFault fault, double now_s);
  /// The carriage slips against the encoder by `distance`, at once. Homing finds the truth again.
  void slip(double distance, double now_s);

  const StageDynamics& dynamics() const { return dynamics_; }

 private:
  void advance(double now_s);
  void drop_torque(double now_s);
  void keep_play(double now_s);
  void replace_ramp(const StageRamp& ramp, double now_s);
  void begin_ramp(double target, double speed, double acceleration, double now_s);
  void stop_at_limits(double now_s);
  void halt_at(double now_s);
  void stand(double position, double now_s);
  double commanded(double now_s) const;
  double actual(double now_s) const;
  double actual_velocity(double now_s) const;
  double carriage(double now_s) const;
  double program_end_s() const;
  bool bounces(double now_s) const;

  const StageDynamics dynamics_;
  const uint64_t seed_;
  std::mutex mutex_;
  std::mt19937_64 random_;

  StageRamp ramp_, previous_;
  std::vector<StageRamp> program_;  ///< What follows the present ramp, each when the one before has ended.
  double power_on_offset_;          ///< Encoder minus its homed reading, until homed.
  double slip_ = 0;                 ///< Carriage minus encoder.
  double play_ = 0;                 ///< Where the play left the carriage, in the encoder's coordinate.
  double rest_error_ = 0;           ///< True minus encoder at the end of the present ramp.
  double previous_rest_error_ = 0;
  bool servo_on_ = false;
  std::optional<double> homing_ends_s_;
  HomingFailure homing_outcome_ = HomingFailure::kNone;  ///< What the homing under way will come to.
  HomingFailure homing_failure_ = HomingFailure::kNone;
  bool homed_ = false;
  /// The present ramp was a move (not a halt) and counts as in position when it ends.
  bool reached_target_ = false;
  bool limit_ahead_ = false;  ///< The present program ends at a limit switch.
  double watchdog_s_ = std::numeric_limits<double>::infinity();

  bool stuck_ = false, dead_home_switch_ = false, limit_bounce_ = false;
  double stuck_at_ = 0;
  int runaway_ = 0;
  std::optional<StageRamp> runaway_ramp_;
};

}  // namespace gantry
