#include "play.h"

#include <unistd.h>

#include <atomic>
#include <cstdio>

#include "gantry/acquisition/run.h"
#include "motion_commands.h"

namespace gantry {
namespace {

constexpr double kGiveUp_s = 3600;
/// Thrown out of a wait of the controller that does not end.
struct Endless {};
/// After the last fault: contacts settle, drives that stopped by themselves stand.
constexpr double kSettled_s = 3.0;
/// A person looks at the message, mends and types.
constexpr double kPause_s = 1.5;

/// A folder in memory where there is one: a campaign syncs to it thousands of times.
class ScratchFolder {
 public:
  ScratchFolder() {
    static std::atomic<int> number{0};
    const std::filesystem::path memory = "/dev/shm";
    const auto base = ::access(memory.c_str(), W_OK) == 0 ? memory : std::filesystem::temp_directory_path();
    path_ = base / ("gantry-campaign-" + std::to_string(::getpid()) + "-" + std::to_string(++number));
  }
  ~ScratchFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Three viewpoints that use most of the ranges.
Plan short_plan(const Cell& cell) {
  Plan plan;
  plan.name = "campaign";
  for (const auto& [name, share] : {std::pair{"a", 0.35}, std::pair{"b", 0.6}, std::pair{"c", 0.15}}) {
    Viewpoint view;
    view.name = name;
    view.exposure_s = 0.1;
    for (const AxisSettings& axis : cell.axes)
      view.q.push_back(axis.lowest_target() + share * (axis.highest_target() - axis.lowest_target()));
    plan.viewpoints.push_back(std::move(view));
  }
  return plan;
}

std::string word(AxisReason reason) {
  switch (reason) {
    case AxisReason::kDriveFault:
      return "exchange failed";
    case AxisReason::kAlarm:
      return "alarm";
    case AxisReason::kEmergencyStop:
      return "emergency stop";
    case AxisReason::kServoLost:
      return "servo lost";
    case AxisReason::kHomingTimeout:
    case AxisReason::kHomingFailed:
      return "homing failed";
    case AxisReason::kNotArrived:
      return "not arrived";
    case AxisReason::kFollowingError:
      return "following error";
    case AxisReason::kLimitSwitch:
      return "limit switch";
    case AxisReason::kSoftLimit:
      return "soft limit";
    case AxisReason::kDrift:
      return "drift";
    case AxisReason::kStaleData:
      return "old readings";
    case AxisReason::kSafety:
      return "safety chain";
    case AxisReason::kResetFailed:
      return "reset refused";
    case AxisReason::kServoDidNotComeOn:
      return "servo did not come on";
    default:
      return "stopped";
  }
}

class Play {
 public:
  Play(const CampaignCell& setup, const FaultSchedule& schedule, const CampaignHooks& hooks)
      : setup_(setup),
        plan_(short_plan(setup.cell)),
        rig_(setup, schedule.seed, hooks),
        player_(schedule, rig_),
        invariants_(rig_, player_),
        folder_(scratch_.path() / "run", {}, false) {
    result_.faults.resize(schedule.entries.size());
    begun_.resize(schedule.entries.size());
    player_.on_change([this](size_t entry, FaultPlayer::Phase phase, double now_s) {
      changed_s_ = now_s;
      const FaultEntry& fault = player_.schedule().entries[entry];
      const bool once = fault.mode == FaultMode::kSlip;
      tell(fault.text() + (once ? "" : phase == FaultPlayer::Phase::kBegin ? " begins" : " ends"));
      if (phase == FaultPlayer::Phase::kBegin) {
        result_.faults[entry].played = true;
        begun_[entry] = now_s;
      }
    });
    rig_.on_exposure = [this] { player_.notify(FaultEvent::kExposure, rig_.clock().now_s()); };
    rig_.clock().on_step([this](double now_s) { step(now_s); });
  }
  ~Play() {
    rig_.clock().on_step(nullptr);  // Leaving is no part of the run.
  }

  PlayResult run() {
    rig_.start_controller();
    tell("the run begins");
    bool done = false;
    while (!done && !invariants_.violation()) {
      const double now_s = rig_.clock().now_s();
      // Nothing is wrong any more, and what waits for an event may still come.
      const bool mended = !player_.any_active() && now_s > changed_s_ + kSettled_s;
      const double mended_s = changed_s_;
      const auto outcome = guarded_attempt();
      done = outcome.has_value();
      if (done || invariants_.violation()) break;
      tell("attempt " + std::to_string(result_.attempts) + " failed: " + outcome.error().text());
      note_reaction(outcome.error());
      if (mended && changed_s_ == mended_s)
        invariants_.fail("recovery", rig_.clock().now_s(), "with nothing wrong: " + outcome.error().text());
      if (rig_.clock().now_s() > kGiveUp_s)
        invariants_.fail("progress", rig_.clock().now_s(), "the run is not done: " + outcome.error().text());
      idle(kPause_s);
    }
    const std::vector<ScanRecord> records = folder_.journal().scans();
    if (!invariants_.violation()) invariants_.check_scans(records, folder_.path());
    if (done && !invariants_.violation() && records.size() != plan_.viewpoints.size())
      invariants_.fail("scans", rig_.clock().now_s(), "the run is done, but scans are missing");
    result_.violation = invariants_.violation();
    result_.simulated_s = rig_.clock().now_s();
    result_.scans = static_cast<int>(records.size());
    result_.slipped_scans = invariants_.slipped_scans();
    return result_;
  }

 private:
  void step(double now_s) {
    player_.advance(now_s);
    invariants_.check(now_s);
    if (now_s > 2 * kGiveUp_s) throw Endless();
    if (invariants_.started_moving()) player_.notify(FaultEvent::kMotion, now_s);
  }

  void tell(const std::string& what) {
    char time[32];
    std::snprintf(time, sizeof time, "%8.2f s  ", rig_.clock().now_s());
    result_.story.push_back(time + what);
  }

  void idle(double duration_s) {
    const double end_s = rig_.clock().now_s() + duration_s;
    while (rig_.clock().now_s() < end_s && !invariants_.violation()) (void)rig_.motion()->watch_for(0);
  }

  Result<void> guarded_attempt() {
    try {
      return attempt();
    } catch (const Endless&) {
      invariants_.fail("progress", rig_.clock().now_s(), "a command of the controller does not end");
      return fault(FaultKind::kTimeout, "cell", "endless");
    }
  }

  // Every second one as after a new start of the program; the first time the program is new anyway.
  Result<void> attempt() {
    ++result_.attempts;
    if (result_.attempts > 1 && (result_.attempts % 2 == 0 || !connected_)) {
      connected_ = false;
      rig_.start_controller();
    }
    Motion& motion = *rig_.motion();
    motion.cancel_when([this] { return invariants_.violation().has_value(); });
    if (!connected_) {
      // As `gantry-cell reset` does: an alarm that is found on connecting is what the reset is for.
      const auto connected = motion.connect();
      if (!connected && result_.attempts == 1) return connected;
      connected_ = connected.has_value();
    }
    if (auto connected = rig_.scanner().connect(); !connected) return connected;
    idle(0.2);  // As the commands do: the contacts are read closed for long enough.
    if (result_.attempts > 1)
      if (auto reset = motion.reset(); !reset) return reset;
    if (auto powered = power_up(setup_.cell, motion); !powered) return powered;
    if (auto homed = motion.home(setup_.cell.homing_order); !homed) return homed;
    RunObserver observer;
    observer.scan = [](const TaggedScan&) {};
    return execute_plan(setup_.cell, plan_, motion, rig_.scanner(), folder_, rig_.clock(), observer);
  }

  // To whatever was wrong a moment ago.
  void note_reaction(const Fault& failure) {
    const SupervisorStatus status = rig_.motion()->figures();
    const AxisFigures& first = status.axes[status.first_failed];
    std::string reaction = first.state == AxisState::kErrorStop ? word(first.error.reason)
                                                                : std::string(to_string(failure.kind));
    if (failure.device == "safety chain") reaction = "safety chain";
    const double now_s = rig_.clock().now_s();
    for (size_t k = 0; k < begun_.size(); ++k) {
      const double for_s = player_.schedule().entries[k].for_s;
      const bool recent = result_.faults[k].played && now_s < begun_[k] + for_s + 2;
      if (recent && result_.faults[k].reaction.empty()) result_.faults[k].reaction = reaction;
    }
  }

  const CampaignCell& setup_;
  const Plan plan_;
  CampaignRig rig_;
  FaultPlayer player_;
  Invariants invariants_;
  ScratchFolder scratch_;
  RunFolder folder_;
  PlayResult result_;
  std::vector<double> begun_;
  double changed_s_ = 0;
  bool connected_ = false;
};

}  // namespace

PlayResult play(const CampaignCell& setup, const FaultSchedule& schedule, const CampaignHooks& hooks) {
  return Play(setup, schedule, hooks).run();
}

}  // namespace gantry
