#pragma once

#include <functional>
#include <vector>

#include "gantry/sim/fault_schedule.h"

namespace gantry {

/// The devices that a player acts on: simulated ones in this process, or a twin's servers.
class FaultTarget {
 public:
  virtual ~FaultTarget() = default;
  virtual void begin(const FaultEntry& entry, double now_s) = 0;
  /// Reverses it. What a device has made of the fault (an alarm, a lost home position) stays.
  virtual void end(const FaultEntry& entry, double now_s) = 0;
};

/// Plays a schedule: begins each fault when its time or its event has come and reverses it afterwards.
/// Two faults of one kind may overlap: the device is repaired when the last of them ends. The owner calls
/// advance() often, with the time since the schedule began; not thread-safe.
class FaultPlayer {
 public:
  enum class Phase { kBegin, kEnd };
  using Observer = std::function<void(size_t entry, Phase phase, double now_s)>;

  /// `target` must outlive the player.
  FaultPlayer(FaultSchedule schedule, FaultTarget& target);
  void on_change(Observer observer) { observer_ = std::move(observer); }

  /// Everything that is due by now, in the order of its times.
  void advance(double now_s);
  /// The event has happened.
  void notify(FaultEvent event, double now_s);
  /// When something is due next, if that is known already.
  std::optional<double> next_s() const;

  bool active(size_t entry) const { return states_[entry].phase == State::kActive; }
  bool over(size_t entry) const { return states_[entry].phase == State::kOver; }
  bool any_active() const;
  /// Every fault has ended, or waits for an event that has not come.
  bool quiet() const;
  const FaultSchedule& schedule() const { return schedule_; }

 private:
  struct State {
    enum Phase { kWaiting, kActive, kOver } phase = kWaiting;
    std::optional<double> due_s;  ///< Of its beginning, then of its end.
  };
  void begin(size_t entry, double now_s);
  void end(size_t entry, double now_s);

  const FaultSchedule schedule_;
  FaultTarget& target_;
  Observer observer_;
  std::vector<State> states_;
  int motions_ = 0, exposures_ = 0;
};

}  // namespace gantry
