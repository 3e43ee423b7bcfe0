#pragma once

#include <optional>
#include <string>
#include <vector>

#include "campaign_rig.h"
#include "gantry/acquisition/journal.h"

namespace gantry {

/// A rule that was broken.
struct Violation {
  std::string invariant;  ///< One of: limits, stops, homed, torque, recovery, scans, progress.
  double at_s = 0;
  std::string detail;
};

/// Looks at the true state of the stages after every step of the clock and holds it against the rules of
/// docs/faults.md. What the controller believes is used for one thing only: to know that it is homing, or
/// that it has seen an error and must have stopped by now.
class Invariants {
 public:
  Invariants(CampaignRig& rig, const FaultPlayer& player);

  /// One step has passed.
  void check(double now_s);
  /// The plan is done, or was left: what the journal claims, against what was.
  void check_scans(const std::vector<ScanRecord>& records, const std::filesystem::path& run);
  void fail(const std::string& invariant, double now_s, const std::string& detail);
  const std::optional<Violation>& violation() const { return violation_; }

  bool started_moving() const { return started_; }  ///< In the last step, after all had stood.
  int slipped_scans() const { return slipped_scans_; }
  double worst_beyond_mm_or_rad() const { return worst_beyond_; }

 private:
  struct AxisTruth {
    double slip = 0;  ///< Since the last homing.
    bool homed = false, homing = false;
    double lowest_allowed = 0, highest_allowed = 0;
    double disturbed_until_s = 0;  ///< The mechanics ran away or were let go.
    double unreachable_until_s = 0;
    double may_home_until_s = 0;
    std::optional<double> error_since_s;
  };

  void follow_faults(double now_s);
  void check_axis(size_t i, const StageState& stage, AxisState state, double now_s);
  void check_torque(const std::vector<StageState>& stages, double now_s);
  void follow_exposure(const std::vector<StageState>& stages);
  double stop_deadline_s(size_t axis) const;
  double tag_tolerance(size_t axis) const;
  std::string format(size_t axis, double value) const;

  CampaignRig& rig_;
  const FaultPlayer& player_;
  std::vector<AxisTruth> axes_;
  std::vector<bool> was_active_;  ///< In the step before; a slip: it has been counted.
  std::optional<double> open0_since_s_, open1_since_s_;
  bool moving_ = false, started_ = false;
  int slipped_scans_ = 0;
  double worst_beyond_ = 0;
  std::optional<Violation> violation_;
};

}  // namespace gantry
