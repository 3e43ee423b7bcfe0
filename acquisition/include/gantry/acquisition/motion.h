#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "gantry/acquisition/cell.h"
#include "gantry/hal/axis.h"

namespace gantry {

/// Proof that the stages stood still: encoder readings over the settling time.
struct Standstill {
  std::vector<double> q;  ///< Mean of the readings, mm or rad.
  double spread = 0;      ///< Largest range of any axis's readings, in units of its in-position band.
  int samples = 0;
  double duration_s = 0;
};

/// All axes of the cell as one: they are enabled, homed and moved together, and any fault of one stops
/// every other before the call returns.
class Motion {
 public:
  /// Called about ten times a second while something moves.
  using Progress = std::function<void(const std::vector<AxisStatus>&)>;

  Motion(std::vector<std::unique_ptr<Axis>> axes, std::vector<AxisSettings> settings, Clock& clock);
  ~Motion();  ///< Stops what still moves.

  void on_progress(Progress progress) { progress_ = std::move(progress); }
  /// Asked between readings; once true, the axes are stopped and the call ends with a kRefused fault.
  void cancel_when(std::function<bool()> cancelled) { cancelled_ = std::move(cancelled); }

  Result<void> connect();
  Result<void> enable();
  /// Homes the named axes one after the other; axes already homed are homed again.
  Result<void> home(const std::vector<std::string>& order);
  bool homed() const;
  /// Starts all axes, waits until all have arrived, and proves standstill from encoder samples over the
  /// settling time: every reading within the in-position band around the target.
  Result<Standstill> move_to(std::span<const double> q);
  /// Samples the encoders once.
  Result<std::vector<double>> read_positions();
  /// Stops everything that moves and waits until it stands (3 s at most; axes that do not answer are not
  /// waited for).
  void stop_all(const std::string& reason);
  /// Clears errors; the axes are Disabled afterwards.
  Result<void> reset();

  const std::vector<std::unique_ptr<Axis>>& axes() const { return axes_; }

 private:
  tl::unexpected<Fault> stopped_by(Fault fault);
  Result<void> wait_for_standstill();
  Result<void> update_all();

  std::vector<std::unique_ptr<Axis>> axes_;
  std::vector<AxisSettings> settings_;
  Clock& clock_;
  Progress progress_;
  std::function<bool()> cancelled_;
  double last_progress_s_ = -1e9;
};

}  // namespace gantry
