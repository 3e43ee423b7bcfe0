#include "campaign_rig.h"

#include <algorithm>

#include "gantry/sim/devices.h"

namespace gantry {
namespace {

constexpr int kWidth = 16, kHeight = 10;
constexpr const char* kSharedBus = "drives";

std::string bus_name(const AxisSettings& axis) {
  return axis.drive.profile == "simulated" ? kSharedBus : axis.drive.bus_key();
}

/// The world wants a part; nothing looks at it.
TriangleMesh plate() {
  return {{{-900, -900, 0}, {900, -900, 0}, {0, 900, 0}}, {{0, 1, 2}, {0, 2, 1}}};
}

/// The controller's end of a drive that outlives the controller.
class BorrowedDrive final : public Drive {
 public:
  explicit BorrowedDrive(Drive& drive) : drive_(drive) {}
  const DriveInfo& info() const override { return drive_.info(); }
  Result<void> connect() override { return drive_.connect(); }
  Result<DriveStatus> read_status() override { return drive_.read_status(); }
  Result<void> set_servo(bool on) override { return drive_.set_servo(on); }
  Result<void> start_homing() override { return drive_.start_homing(); }
  Result<void> start_move(const MoveCommand& command) override { return drive_.start_move(command); }
  Result<void> halt() override { return drive_.halt(); }
  Result<void> reset_alarm() override { return drive_.reset_alarm(); }
  Result<void> set_communication_timeout(double timeout_s) override {
    return drive_.set_communication_timeout(timeout_s);
  }
  bool moves_unhomed() const override { return drive_.moves_unhomed(); }

 private:
  Drive& drive_;
};

std::vector<std::string> axis_names(const Cell& cell) {
  std::vector<std::string> names;
  for (const AxisSettings& axis : cell.axes) names.push_back(axis.name);
  return names;
}

}  // namespace

Scan numbered_scan(size_t frame) {
  Scan scan;
  scan.width = kWidth;
  scan.height = kHeight;
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u)
      scan.points.emplace_back(static_cast<float>(u), static_cast<float>(v),
                               400.0f + static_cast<float>(frame));
  return scan;
}

CampaignCell read_campaign_cell(const std::filesystem::path& path) {
  CampaignCell setup{read_cell(path), {}};
  StrictYaml yaml = StrictYaml::load(path);
  if (!yaml.has("simulation"))
    throw InputError(path.string() + ": a campaign needs the simulation section of the cell");
  setup.simulation = read_simulation(yaml.map("simulation"), setup.cell.chain);
  return setup;
}

FaultTargetNames fault_targets(const Cell& cell) {
  FaultTargetNames names;
  for (const AxisSettings& axis : cell.axes) {
    names.axes.push_back({axis.name, axis.kind == AxisKind::kRotary});
    const std::string bus = bus_name(axis);
    if (std::find(names.buses.begin(), names.buses.end(), bus) == names.buses.end())
      names.buses.push_back(bus);
  }
  if (cell.safety)
    for (const SafetyInputSettings& input : cell.safety->chain.inputs)
      names.safety.push_back({input.name, static_cast<int>(input.channels.size())});
  return names;
}

void SteppingClock::sleep_s(double duration_s) {
  const double end_s = now_s_ + duration_s;
  while (now_s_ < end_s) {
    now_s_ = std::min(end_s, now_s_ + step_s_);
    if (step_) step_(now_s_);
  }
}

// ---- The camera -------------------------------------------------------------------------------

class CampaignRig::Camera final : public Scanner {
 public:
  explicit Camera(CampaignRig& rig) : rig_(rig) {
    info_.vendor = "Gantry";
    info_.model = "campaign";
    info_.serial = "in-process";
    info_.width = kWidth;
    info_.height = kHeight;
  }
  const ScannerInfo& info() const override { return info_; }
  Result<void> connect() override {
    if (silent) return fault(FaultKind::kUnreachable, info_.text(), "no answer");
    return {};
  }
  // The loop goes on while the camera works, as it does in real time on a thread of its own.
  Result<Capture> capture(const CaptureSettings& settings) override {
    if (silent) return no_answer(settings);
    rig_.exposures_.emplace_back();
    rig_.exposing_ = true;
    rig_.on_exposure();
    pass(settings.exposure_s);
    rig_.exposing_ = false;
    Capture capture;
    capture.scan = numbered_scan(rig_.exposures_.size());
    if (silent) return no_answer(settings);
    if (data_loss) return fault(FaultKind::kDataLoss, info_.text(), "packets were lost for good");
    capture.frame_id = rig_.exposures_.size();
    capture.device_timestamp_ns = static_cast<uint64_t>(rig_.clock_.now_s() * 1e9);
    capture.exposure_s = settings.exposure_s;
    return capture;
  }

  bool silent = false, data_loss = false;

 private:
  void pass(double duration_s) {
    const double end_s = rig_.clock_.now_s() + duration_s;
    while (rig_.clock_.now_s() < end_s) (void)rig_.motion_->watch_for(0);
  }
  Result<Capture> no_answer(const CaptureSettings& settings) {
    pass(settings.timeout_s);
    return fault(FaultKind::kTimeout, info_.text(), "no answer");
  }

  CampaignRig& rig_;
  ScannerInfo info_;
};

// ---- The rig ----------------------------------------------------------------------------------

CampaignRig::CampaignRig(const CampaignCell& setup, uint64_t seed, const CampaignHooks& hooks)
    : setup_(setup), hooks_(hooks), clock_(setup.cell.supervisor.period_s) {
  const Cell& cell = setup.cell;
  static const TriangleMesh mesh = plate();
  world_ = std::make_unique<SimulatedWorld>(cell.chain, setup.simulation, mesh, std::nullopt, seed, clock_);
  bus_names_ = fault_targets(cell).buses;
  for (size_t k = 0; k < bus_names_.size(); ++k) buses_.push_back(std::make_unique<FaultyBus>(seed + k));
  for (size_t i = 0; i < cell.axes.size(); ++i) {
    const auto bus = std::find(bus_names_.begin(), bus_names_.end(), bus_name(cell.axes[i]));
    bus_of_axis_.push_back(static_cast<size_t>(bus - bus_names_.begin()));
    drives_.push_back(std::make_unique<FaultyDrive>(make_simulated_drive(cell.axes[i].name, *world_, i),
                                                    world_->stage(i), *buses_[bus_of_axis_[i]],
                                                    static_cast<int>(i) + 1, clock_));
  }
  if (cell.safety) contacts_ = make_safety_contacts(*cell.safety, clock_);
  physical_ = std::make_unique<PhysicalFaults>(*world_, axis_names(cell), contacts_.get());
  auto camera = std::make_unique<Camera>(*this);
  camera_ = camera.get();
  scanner_ = std::move(camera);
}

CampaignRig::~CampaignRig() = default;

void CampaignRig::start_controller() {
  motion_.reset();
  permit_.reset();
  safety_ = {};
  const Cell& cell = setup_.cell;
  MotionOptions options{cell.supervisor, cell.drive_timeout_s, false, bus_of_axis_, {}};
  MotionPermit* permit = nullptr;
  if (cell.safety) {
    std::vector<int> channels;
    for (const SafetyInputSettings& input : cell.safety->chain.inputs)
      channels.insert(channels.end(), input.channels.begin(), input.channels.end());
    safety_.channel =
        std::make_shared<SafetyInputsChannel>(make_simulated_safety_inputs(*contacts_, channels), clock_);
    safety_.permit = std::make_unique<SafetyPermit>(cell.safety->chain, safety_.channel);
    permit = safety_.permit.get();
    if (hooks_.wrap_permit) permit_ = hooks_.wrap_permit(*permit);
    if (permit_) permit = permit_.get();
    options.services.push_back({buses_.size(), [channel = safety_.channel, poll_s = cell.safety->poll_s, this,
                                                due_s = 0.0]() mutable {
                                  if (clock_.now_s() < due_s) return;
                                  due_s = clock_.now_s() + poll_s;
                                  channel->service();
                                }});
  }
  std::vector<std::unique_ptr<Axis>> axes;
  for (size_t i = 0; i < cell.axes.size(); ++i) {
    std::unique_ptr<Drive> drive = std::make_unique<BorrowedDrive>(*drives_[i]);
    if (hooks_.wrap_drive) drive = hooks_.wrap_drive(std::move(drive), i);
    axes.push_back(std::make_unique<Axis>(std::move(drive), cell.axes[i].kind, cell.axes[i].limits, clock_));
  }
  motion_ = std::make_unique<Motion>(std::move(axes), cell.axes, options, clock_, permit);
}

FaultyBus& CampaignRig::bus_named(const std::string& name) {
  const auto found = std::find(bus_names_.begin(), bus_names_.end(), name);
  if (found == bus_names_.end()) throw InputError("faults: there is no bus '" + name + "'");
  return *buses_[static_cast<size_t>(found - bus_names_.begin())];
}

void CampaignRig::begin(const FaultEntry& entry, double) {
  if (physical_->begin(entry)) return;
  if (entry.device == FaultDevice::kCamera) {
    (entry.mode == FaultMode::kSilent ? camera_->silent : camera_->data_loss) = true;
    return;
  }
  if (entry.device == FaultDevice::kBus) {
    FaultyBus& bus = bus_named(entry.name);
    if (entry.mode == FaultMode::kDisconnect) bus.connected = false;
    if (entry.mode == FaultMode::kDelayReply) bus.wire.set_delay_s(entry.delay_s);
    if (const auto wire = wire_fault_of(entry.mode)) bus.wire.set_probability(*wire, entry.probability);
    return;
  }
  FaultyDrive& drive = *drives_[physical_->axis(entry)];
  if (entry.mode == FaultMode::kAlarm) drive.raise_alarm(entry.code);
  if (entry.mode == FaultMode::kEmergencyStop) drive.set_emergency_stop(true);
  if (entry.mode == FaultMode::kPowerLoss) drive.set_supply(false);
  if (entry.mode == FaultMode::kSilent) drive.set_silent(true);
}

void CampaignRig::end(const FaultEntry& entry, double) {
  if (physical_->end(entry)) return;
  if (entry.device == FaultDevice::kCamera) {
    (entry.mode == FaultMode::kSilent ? camera_->silent : camera_->data_loss) = false;
    return;
  }
  if (entry.device == FaultDevice::kBus) {
    FaultyBus& bus = bus_named(entry.name);
    if (entry.mode == FaultMode::kDisconnect) bus.connected = true;
    if (const auto wire = wire_fault_of(entry.mode)) bus.wire.set_probability(*wire, 0);
    return;
  }
  FaultyDrive& drive = *drives_[physical_->axis(entry)];
  if (entry.mode == FaultMode::kAlarm) drive.clear_alarm_cause();
  if (entry.mode == FaultMode::kEmergencyStop) drive.set_emergency_stop(false);
  if (entry.mode == FaultMode::kPowerLoss) drive.set_supply(true);
  if (entry.mode == FaultMode::kSilent) drive.set_silent(false);
}

}  // namespace gantry
