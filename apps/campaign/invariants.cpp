#include "invariants.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "gantry/acquisition/journal.h"
#include "gantry/geometry/scan_file.h"

namespace gantry {
namespace {

constexpr double kStill = 1e-9;
/// From the wish to stop to torque off where a halt does not help (docs/motion.md), and what the loop, the
/// exchange and the reading before need.
constexpr double kHaltMargin_s = 0.3, kReaction_s = 0.1;
/// Sigmas of the stages' repeatability that a rest position may be off.
constexpr double kSigmas = 6;

}  // namespace

Invariants::Invariants(CampaignRig& rig, const FaultPlayer& player)
    : rig_(rig),
      player_(player),
      axes_(rig.setup().cell.axes.size()),
      was_active_(player.schedule().entries.size()) {}

void Invariants::fail(const std::string& invariant, double now_s, const std::string& detail) {
  if (!violation_) violation_ = {invariant, now_s, detail};
}

std::string Invariants::format(size_t axis, double value) const {
  return rig_.setup().cell.axes[axis].name + " at " +
         format_position(rig_.setup().cell.axes[axis].kind, value);
}

// Braking, then the torque taken away; a drive that hears nothing stops by itself, if it was told to.
double Invariants::stop_deadline_s(size_t axis) const {
  const Cell& cell = rig_.setup().cell;
  return cell.axes[axis].limits.braking_s() + kHaltMargin_s + kReaction_s + cell.drive_timeout_s;
}

double Invariants::tag_tolerance(size_t axis) const {
  const StageDynamics& stage = rig_.setup().simulation.stages[axis];
  return stage.encoder_resolution + kSigmas * stage.repeatability_sigma + stage.backlash;
}

void Invariants::follow_faults(double now_s) {
  const auto& entries = player_.schedule().entries;
  for (size_t k = 0; k < entries.size(); ++k) {
    const FaultEntry& entry = entries[k];
    const bool active = player_.active(k);
    for (size_t i = 0; i < axes_.size(); ++i) {
      AxisTruth& axis = axes_[i];
      const bool mine = entry.device == FaultDevice::kAxis && entry.name == rig_.setup().cell.axes[i].name;
      const bool my_bus = entry.device == FaultDevice::kBus && entry.name == rig_.bus_names()[rig_.bus_of(i)];
      const bool mechanics = entry.mode == FaultMode::kRunaway || entry.mode == FaultMode::kStuck;
      if (mine && mechanics && (active || was_active_[k]))
        axis.disturbed_until_s = now_s + stop_deadline_s(i);
      const bool cut = entry.mode == FaultMode::kSilent || entry.mode == FaultMode::kPowerLoss;
      if (((mine && cut) || my_bus) && (active || was_active_[k]))
        axis.unreachable_until_s = now_s + kReaction_s;
    }
    if (entry.mode != FaultMode::kSlip) was_active_[k] = active;
  }
}

void Invariants::check(double now_s) {
  if (violation_) return;
  follow_faults(now_s);
  std::vector<StageState> stages;
  for (size_t i = 0; i < axes_.size(); ++i) stages.push_back(rig_.world().stage(i).observe(now_s));
  const SupervisorStatus status = rig_.motion() ? rig_.motion()->figures() : SupervisorStatus{};
  bool moving = false;
  for (size_t i = 0; i < axes_.size(); ++i) {
    moving = moving || std::abs(stages[i].velocity) > kStill;
    check_axis(i, stages[i], status.axes[i].state, now_s);
  }
  started_ = moving && !moving_;
  moving_ = moving;
  check_torque(stages, now_s);
  follow_exposure(stages);
}

void Invariants::check_axis(size_t i, const StageState& stage, AxisState state, double now_s) {
  AxisTruth& axis = axes_[i];
  const AxisLimits& limits = rig_.setup().cell.axes[i].limits;
  const double position = stage.true_position + limits.position_at_home;
  const bool moves = std::abs(stage.velocity) > kStill;
  if (state == AxisState::kHoming && !axis.homing) axis.slip = 0;  // The switches are on the carriage.
  axis.homing = state == AxisState::kHoming;
  if (stage.homed && !axis.homed) {  // Homing may end outside the soft limits: from there only inwards.
    axis.lowest_allowed = std::min(limits.lower, position);
    axis.highest_allowed = std::max(limits.upper, position);
  }
  axis.homed = stage.homed;

  // Un-homed nothing moves but homing, and what that needs to stop.
  const bool unheard = now_s <= axis.unreachable_until_s && now_s <= axis.may_home_until_s;
  if (state == AxisState::kHoming || unheard) axis.may_home_until_s = now_s + stop_deadline_s(i);
  const bool let_go = now_s <= axis.disturbed_until_s;
  if (moves && !stage.homed && now_s > axis.may_home_until_s && !let_go)
    fail("homed", now_s, format(i, position) + " moves without being homed or homing");

  // Limits: beyond them no further than what it takes to notice, and to brake.
  const double notice_s = 4 * rig_.setup().cell.supervisor.period_s;
  const double allowed = limits.speed * notice_s + limits.braking_distance() + 3 * limits.in_position +
                         std::abs(axis.slip) + tag_tolerance(i);
  const double beyond = std::max(axis.lowest_allowed - position, position - axis.highest_allowed);
  if (stage.homed && !let_go) {
    worst_beyond_ = std::max(worst_beyond_, beyond);
    if (moves && beyond > allowed)
      fail("limits", now_s,
           format(i, position) + " is further outside its soft limits than it needs to brake");
  }

  // In error, everything stands within the deadline. No software stops a runaway that does not hear it.
  if (state != AxisState::kErrorStop) {
    axis.error_since_s.reset();
  } else if (!axis.error_since_s) {
    axis.error_since_s = now_s;
  }
  if (axis.error_since_s && moves && now_s > axis.unreachable_until_s && !let_go &&
      now_s - *axis.error_since_s > stop_deadline_s(i))
    fail("stops", now_s,
         format(i, position) + " still moves " + std::to_string(now_s - *axis.error_since_s) +
             " s after the cell was stopped");
}

// The truth is the contacts', not the inputs as they were read.
void Invariants::check_torque(const std::vector<StageState>& stages, double now_s) {
  if (!rig_.contacts()) return;
  const CellSafety& safety = *rig_.setup().cell.safety;
  bool open0 = false, open1 = false;
  for (const SafetyInputSettings& input : safety.chain.inputs)
    for (const int channel : input.channels)
      if (!rig_.contacts()->level(channel)) (input.stop == StopCategory::kCategory0 ? open0 : open1) = true;
  const auto follow = [now_s](bool open, std::optional<double>& since_s) {
    if (!open) since_s.reset();
    if (open && !since_s) since_s = now_s;
  };
  follow(open0, open0_since_s_);
  follow(open0 || open1, open1_since_s_);
  const double noticed_s = safety.poll_s + kReaction_s;
  const bool off0 = open0_since_s_ && now_s - *open0_since_s_ > noticed_s;
  const bool off1 = open1_since_s_ && now_s - *open1_since_s_ > noticed_s + safety.chain.ramp_limit_s;
  if (!off0 && !off1) return;
  for (size_t i = 0; i < axes_.size(); ++i)
    if (stages[i].servo_on && now_s > axes_[i].unreachable_until_s)
      fail("torque", now_s,
           rig_.setup().cell.axes[i].name + " has torque while the safety chain has been open for " +
               std::to_string(now_s - (off0 ? *open0_since_s_ : *open1_since_s_)) + " s");
}

// ---- Scans ------------------------------------------------------------------------------------

void Invariants::follow_exposure(const std::vector<StageState>& stages) {
  for (size_t k = 0; k < player_.schedule().entries.size(); ++k) {
    // A slip is an instant: it counts from the step in which it happened.
    const FaultEntry& entry = player_.schedule().entries[k];
    if (entry.mode != FaultMode::kSlip || was_active_[k] || !player_.over(k)) continue;
    was_active_[k] = true;
    for (size_t i = 0; i < axes_.size(); ++i)
      if (rig_.setup().cell.axes[i].name == entry.name) axes_[i].slip += entry.distance;
  }
  TrueExposure* exposure = rig_.exposing();
  if (!exposure) return;
  exposure->lowest.resize(axes_.size(), 1e300);
  exposure->highest.resize(axes_.size(), -1e300);
  for (size_t i = 0; i < axes_.size(); ++i) {
    const double position = stages[i].true_position + rig_.setup().cell.axes[i].limits.position_at_home;
    exposure->lowest[i] = std::min(exposure->lowest[i], position);
    exposure->highest[i] = std::max(exposure->highest[i], position);
    exposure->slipped = exposure->slipped || axes_[i].slip != 0;
  }
}

void Invariants::check_scans(const std::vector<ScanRecord>& records, const std::filesystem::path& run) {
  const double now_s = rig_.clock().now_s();
  std::set<int> seen;
  for (const ScanRecord& record : records) {
    const std::string name = "scan of viewpoint " + record.viewpoint_name;
    if (!seen.insert(record.viewpoint).second) fail("scans", now_s, name + " is counted twice");
    if (record.frame_id < 1 || record.frame_id > rig_.exposures().size())
      return fail("scans", now_s, name + " was never exposed");
    const TrueExposure& truth = rig_.exposures()[record.frame_id - 1];
    if (read_scan(run / record.file).scan.points != numbered_scan(record.frame_id).points)
      fail("scans", now_s, name + " is not the scan that was exposed");
    std::vector<double> q;
    for (size_t i = 0; i < axes_.size(); ++i) {
      q.push_back(0.5 * (record.q_before[i] + record.q_after[i]));
      if (truth.slipped) continue;
      const double off = std::max(truth.highest[i] - q[i], q[i] - truth.lowest[i]);
      if (off > tag_tolerance(i))
        fail("scans", now_s,
             name + " is tagged with " + format(i, q[i]) + "; the stage stood between " +
                 format(i, truth.lowest[i]) + " and " + format(i, truth.highest[i]));
    }
    if (truth.slipped) ++slipped_scans_;
    const Pose expected = rig_.setup().cell.chain.uncertain_part_from_sensor(q).mean;
    if (!record.part_from_sensor.mean.isApprox(expected, 1e-9))
      fail("scans", now_s, name + " has a pose that is not that of its axes");
  }
}

}  // namespace gantry
