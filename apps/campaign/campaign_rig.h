#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cell_safety.h"
#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/motion.h"
#include "gantry/sim/fault_player.h"
#include "gantry/sim/faulty_drive.h"
#include "gantry/sim/physical_faults.h"
#include "gantry/sim/world.h"

namespace gantry {

/// A cell and its physics, read once and shared by every schedule that is played against it.
struct CampaignCell {
  Cell cell;
  SimulationSettings simulation;
};
/// Reads CELL.yaml; its drives, whatever they are, are simulated in this process behind faulty wires, with a
/// camera that sees nothing of the part. Throws InputError for a cell without a simulation section.
CampaignCell read_campaign_cell(const std::filesystem::path& path);
/// What a schedule for the cell may name. Drives that CELL.yaml puts on no bus share one called "drives".
FaultTargetNames fault_targets(const Cell& cell);

/// Where a test puts something broken between the controller and the cell. Empty: nothing is.
struct CampaignHooks {
  std::function<std::unique_ptr<Drive>(std::unique_ptr<Drive>, size_t axis)> wrap_drive;
  std::function<std::unique_ptr<MotionPermit>(MotionPermit&)> wrap_permit;
};

/// Time that passes when somebody sleeps, in steps at which something may happen. One thread.
class SteppingClock final : public Clock {
 public:
  explicit SteppingClock(double step_s) : step_s_(step_s) {}
  double now_s() const override { return now_s_; }
  void sleep_s(double duration_s) override;
  void on_step(std::function<void(double now_s)> step) { step_ = std::move(step); }

 private:
  const double step_s_;
  double now_s_ = 0;
  std::function<void(double)> step_;
};

/// Where the stages truly were during one exposure.
struct TrueExposure {
  std::vector<double> lowest, highest;
  bool slipped = false;  ///< An encoder had slipped since its last homing: nobody can know.
};
/// What the camera delivers: small, and no two frames are alike, so that a mixed-up scan shows.
Scan numbered_scan(size_t frame);

/// All devices of one schedule: the world, faulty drives, contacts, a camera that can fail; and the
/// controller on them, which can be thrown away and made anew as when the program is started again.
class CampaignRig final : public FaultTarget {
 public:
  CampaignRig(const CampaignCell& setup, uint64_t seed, const CampaignHooks& hooks);
  ~CampaignRig() override;

  void start_controller();
  Motion* motion() { return motion_.get(); }
  Scanner& scanner() { return *scanner_; }

  void begin(const FaultEntry& entry, double now_s) override;
  void end(const FaultEntry& entry, double now_s) override;

  std::function<void()> on_exposure = [] {};  ///< The camera has been triggered.

  const CampaignCell& setup() const { return setup_; }
  SteppingClock& clock() { return clock_; }
  SimulatedWorld& world() { return *world_; }
  FaultyDrive& drive(size_t axis) { return *drives_[axis]; }
  size_t bus_of(size_t axis) const { return bus_of_axis_[axis]; }
  const std::vector<std::string>& bus_names() const { return bus_names_; }
  SafetyContacts* contacts() { return contacts_.get(); }
  std::vector<TrueExposure>& exposures() { return exposures_; }  ///< Number k is frame k + 1.
  TrueExposure* exposing() { return exposing_ ? &exposures_.back() : nullptr; }

 private:
  class Camera;
  FaultyBus& bus_named(const std::string& name);

  const CampaignCell& setup_;
  const CampaignHooks& hooks_;
  SteppingClock clock_;
  std::unique_ptr<SimulatedWorld> world_;
  std::vector<std::unique_ptr<FaultyBus>> buses_;
  std::vector<std::string> bus_names_;
  std::vector<size_t> bus_of_axis_;
  std::vector<std::unique_ptr<FaultyDrive>> drives_;
  std::unique_ptr<SafetyContacts> contacts_;
  std::unique_ptr<PhysicalFaults> physical_;
  std::vector<TrueExposure> exposures_;
  bool exposing_ = false;
  std::unique_ptr<Scanner> scanner_;
  Camera* camera_ = nullptr;

  SafetyDevices safety_;
  std::unique_ptr<MotionPermit> permit_;  ///< Of the hook.
  std::unique_ptr<Motion> motion_;
};

}  // namespace gantry
