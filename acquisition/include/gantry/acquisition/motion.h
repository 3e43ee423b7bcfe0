#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/motion_threads.h"
#include "gantry/acquisition/supervisor.h"
#include "gantry/hal/axis.h"

namespace gantry {

/// Proof that the stages stood still: encoder readings over the settling time.
struct Standstill {
  std::vector<double> q;  ///< Mean of the readings, mm or rad.
  double spread = 0;      ///< Largest range of any axis's readings, in units of its in-position band.
  int samples = 0;
  double duration_s = 0;
};

/// Asked before the first axis starts: may the axes go from `from` to `to`, on a straight line in joint
/// space?
using PathCheck = std::function<Result<void>(std::span<const double> from, std::span<const double> to)>;

struct MotionOptions {
  SupervisorSettings supervisor;
  double drive_timeout_s = 0;  ///< Asked of every drive at connect(); 0: not.
  /// Real time: loop and I/O run on threads of their own. Otherwise the caller's waiting turns them, cycle
  /// by cycle, on any clock: deterministic, for tests and simulated time.
  bool threads = false;
  std::vector<size_t> bus_of_axis;  ///< Axes with the same number share an I/O thread; empty: each its own.
  std::vector<IoService> services;  ///< What the permit, for one, is to be read from.
};

/// All axes of the cell as one, for callers that want to wait: they are enabled, homed and moved together,
/// and any fault of one stops every other. The work is the Supervisor's; this class requests and waits.
/// One caller at a time; keep_jogging(), request_stop() and, once connected, statuses() and all figures may
/// be called from any thread.
class Motion {
 public:
  /// Called about ten times a second while something moves.
  using Progress = std::function<void(const std::vector<AxisStatus>&)>;

  /// `permit` (the safety chain) may be null. Throws InputError.
  Motion(std::vector<std::unique_ptr<Axis>> axes, std::vector<AxisSettings> settings, MotionOptions options,
         Clock& clock, MotionPermit* permit = nullptr);
  ~Motion();  ///< Stops what still moves.

  void on_progress(Progress progress) { progress_ = std::move(progress); }
  /// Asked between readings; once true, the axes are stopped and the call ends with a kRefused fault.
  void cancel_when(std::function<bool()> cancelled) { cancelled_ = std::move(cancelled); }
  void set_path_check(PathCheck check) { path_check_ = std::move(check); }

  /// Opens all drives and starts the loop. Every axis is tried; the first fault is returned.
  Result<void> connect();
  /// Powers all axes. Refused while one of them is in ErrorStop.
  Result<void> enable();
  /// Removes the power of axes that stand still.
  Result<void> disable();
  /// Homes group after group; the axes of a group home at the same time. Axes already homed are homed again.
  Result<void> home(const HomingOrder& order);
  bool homed() const;
  /// Starts all axes, waits until all have arrived, and proves standstill from encoder samples over the
  /// settling time: every reading within the in-position band around the target.
  Result<Standstill> move_to(std::span<const double> q);
  /// Moves one axis by `distance` at jog speed, before homing too where its drive can, and waits.
  Result<void> jog_by(size_t axis, double distance);
  /// Starts one axis at jog speed towards the end of its range (`direction` -1 or 1) and returns. It stops
  /// when keep_jogging() is not called for the dead-man time, at the soft limit, or at request_stop().
  Result<void> start_jog(size_t axis, int direction);
  void keep_jogging() { supervisor_.keep_alive(clock_.now_s()); }
  /// A controlled stop of all axes; they stay powered. Any thread.
  void request_stop() { supervisor_.stop(false); }
  /// Lets the cell go on for so long, watching the axes.
  Result<void> watch_for(double duration_s);
  /// The same whatever their state is: what the loop reads has that long to become known.
  void wait_for(double duration_s);
  /// Samples the encoders once: readings made after the call began.
  Result<std::vector<double>> read_positions();
  /// Stops everything that moves and waits until it stands (3 s at most; axes that do not answer are not
  /// waited for). What moved is in ErrorStop then.
  void stop_all(const std::string& reason);
  /// Clears errors, and is the reset edge of the safety chain; the axes are Disabled afterwards.
  Result<void> reset();

  std::vector<AxisStatus> statuses() const;
  SupervisorStatus figures() const { return supervisor_.status(); }
  /// Nothing without threads.
  std::optional<LoopStatistics> loop_statistics() const;
  std::optional<RealTimeGrant> real_time_grant() const;
  /// What is known of limited abilities of the drives: "linear: has no communication time-out".
  const std::vector<std::string>& remarks() const { return remarks_; }
  /// For the fixed facts; the supervisor's thread has the rest.
  const std::vector<std::unique_ptr<Axis>>& axes() const { return axes_; }
  std::optional<size_t> axis_named(const std::string& name) const;

 private:
  void turn();  ///< One period passes.
  Result<void> watch();
  Result<void> send(const MotionRequest& request);
  Result<void> wait_until_still(AxisSet axes);
  Result<void> check_targets(std::span<const double> q) const;
  Result<void> move_line(std::span<const double> from, std::span<const double> to);
  Result<Standstill> prove_standstill(std::span<const double> q);
  std::vector<double> positions() const;
  std::optional<Fault> fault_of(const SupervisorStatus& status) const;
  Fault refused(const SupervisorStatus& status, const MotionRequest& request) const;
  std::string stop_reason() const;
  AxisSet all() const;

  std::vector<std::unique_ptr<Axis>> axes_;
  const std::vector<AxisSettings> settings_;
  const MotionOptions options_;
  Clock& clock_;
  MotionPermit* const permit_;
  Supervisor supervisor_;
  std::unique_ptr<MotionThreads> threads_;
  Progress progress_;
  std::function<bool()> cancelled_;
  PathCheck path_check_;
  std::vector<std::string> remarks_;
  mutable std::mutex reason_mutex_;
  std::string stop_reason_;  ///< Of the last stop_all().
  double last_progress_s_ = -1e9;
  bool connected_ = false;
};

}  // namespace gantry
