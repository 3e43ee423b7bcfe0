// Devices that die while gantry-cell runs: the servers of the twin stand in this process, so that each
// can be made to fail at a chosen moment; gantry-cell is the real program.

#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <numbers>
#include <thread>

#include "apps/process.h"
#include "apps/test_cell.h"
#include "gantry/acquisition/cell.h"
#include "gantry/acquisition/journal.h"
#include "gantry/foundation/strict_yaml.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/scan_file.h"
#include "gantry/sim/safety_contacts.h"
#include "gantry/sim/twin/gige_vision_camera.h"
#include "gantry/sim/twin/modbus_drives.h"
#include "gantry/sim/world.h"

namespace gantry::testing {
namespace {

/// The servers of a cell, as gantry-twin puts them together.
class Twin {
 public:
  explicit Twin(const std::filesystem::path& cell_path) : cell_(read_cell(cell_path)) {
    StrictYaml yaml = StrictYaml::load(cell_path);
    const SimulationSettings settings = read_simulation(yaml.map("simulation"), cell_.chain);
    world_ = std::make_unique<SimulatedWorld>(cell_.chain, settings, read_mesh(settings.part),
                                              read_mesh(settings.holder), 1, clock_);
    for (size_t i = 0; i < cell_.axes.size(); ++i) {
      const DriveSettings& drive = cell_.axes[i].drive;
      auto& server = drives[drive.port];
      if (!server) server = std::make_unique<ModbusDriveServer>(drive.host, drive.port, clock_);
      TwinDriveConfig config{drive.profile, drive.unit, 0.01};
      if (drive.counts_per_axis_unit > 0) config.axis_units_per_count = 1 / drive.counts_per_axis_unit;
      server->add(config, world_->stage(i));
    }
    std::vector<SafetyDevice> devices;
    for (const SafetyInputSettings& input : cell_.safety->chain.inputs)
      devices.push_back({input.name, input.channels});
    contacts = std::make_unique<SafetyContacts>(std::move(devices), clock_);
    const SafetyModuleSettings& module = cell_.safety->module;
    auto& server = drives[module.port];
    if (!server) server = std::make_unique<ModbusDriveServer>(module.host, module.port, clock_);
    server->add_io_module(module.unit, *contacts);
    for (auto& [port, serving] : drives) serving->start();
    GigeVisionOptions options;
    options.address = cell_.scanner.address;
    options.width = world_->sensor().width;
    options.height = world_->sensor().height;
    camera = std::make_unique<GigeVisionCamera>(options, [this](double exposure_s) {
      const Scan scan = world_->expose(exposure_s);
      TriggeredFrame frame;
      frame.xyz.assign(scan.points[0].data(), scan.points[0].data() + 3 * scan.points.size());
      ++frames;
      return frame;
    });
  }

  bool anything_moves() {
    for (size_t i = 0; i < world_->axis_count(); ++i)
      if (world_->stage(i).observe(clock_.now_s()).moving) return true;
    return false;
  }
  bool anything_has_torque() {
    for (size_t i = 0; i < world_->axis_count(); ++i)
      if (world_->stage(i).observe(clock_.now_s()).servo_on) return true;
    return false;
  }
  SimulatedWorld& world() { return *world_; }

  std::unique_ptr<SafetyContacts> contacts;
  std::map<int, std::unique_ptr<ModbusDriveServer>> drives;  ///< And the I/O module, by port.
  std::unique_ptr<GigeVisionCamera> camera;
  std::atomic<int> frames{0};

 private:
  Cell cell_;
  SteadyClock clock_;
  std::unique_ptr<SimulatedWorld> world_;
};

class DeviceFaults : public ::testing::Test {
 protected:
  DeviceFaults() {
    write_text(folder_ / "cell.yaml", small_twin_cell_text());
    write_text(folder_ / "plan.yaml", kThreeViews);
  }

  std::vector<std::string> run_arguments(bool resume = false) {
    std::vector<std::string> arguments = {
        "run", "--cell", folder_ / "cell.yaml", "--plan", folder_ / "plan.yaml", "--out", folder_ / "run"};
    if (resume) arguments.push_back("--resume");
    return arguments;
  }

  /// Runs gantry-cell while `interfere` waits for its moment on another thread.
  ProcessResult run_while(const std::function<void()>& interfere, bool resume = false) {
    std::thread thread(interfere);
    const ProcessResult result = run_program("gantry-cell", run_arguments(resume), 120);
    thread.join();
    return result;
  }

  static void wait_until(const std::function<bool()>& condition) {
    for (int i = 0; i < 3000 && !condition(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    EXPECT_TRUE(condition());
  }

  TemporaryFolder folder_;
};

TEST_F(DeviceFaults, CameraDiesBetweenTwoScansAndTheRunIsResumed) {
  Twin twin(folder_ / "cell.yaml");
  const ProcessResult broken = run_while([&] {
    wait_until([&] { return twin.frames >= 1; });
    wait_until([&] { return Journal(folder_ / "run/journal.sqlite").scans().size() >= 1; });
    twin.camera->set_faults({.silent = true});
  });
  EXPECT_EQ(broken.exit_code, 3) << broken.out << broken.err;
  EXPECT_NE(broken.err.find("scanner"), std::string::npos) << broken.err;
  EXPECT_NE(broken.err.find("127.0.0.71"), std::string::npos) << broken.err;
  EXPECT_NE(broken.err.find("--resume"), std::string::npos) << broken.err;
  EXPECT_FALSE(twin.anything_moves());

  const auto before = Journal(folder_ / "run/journal.sqlite").scans();
  ASSERT_GE(before.size(), 1u);
  ASSERT_LT(before.size(), 3u);
  twin.camera->set_faults({});
  const ProcessResult resumed = run_program("gantry-cell", run_arguments(true), 120);
  EXPECT_TRUE(resumed.exit_code == 0 || resumed.exit_code == 4) << resumed.out << resumed.err;
  const auto after = Journal(folder_ / "run/journal.sqlite").scans();
  ASSERT_EQ(after.size(), 3u);
  for (size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(after[i].captured_at, before[i].captured_at) << "a scan that was safe must not be taken again";
    EXPECT_EQ(after[i].frame_id, before[i].frame_id);
  }
  for (const ScanRecord& scan : after)
    EXPECT_GT(read_scan(folder_ / ("run/" + scan.file)).scan.valid_count(), 1000u);
}

TEST_F(DeviceFaults, DriveAlarmInMotionStopsAllAxes) {
  Twin twin(folder_ / "cell.yaml");
  const ProcessResult broken = run_while([&] {
    wait_until([&] { return twin.frames >= 1; });
    wait_until([&] { return twin.anything_moves(); });
    twin.drives.at(15122)->raise_alarm(2, 0x30);
  });
  EXPECT_EQ(broken.exit_code, 3) << broken.out << broken.err;
  EXPECT_NE(broken.err.find("axis rotation"), std::string::npos) << broken.err;
  EXPECT_NE(broken.err.find("alarm"), std::string::npos) << broken.err;
  EXPECT_FALSE(twin.anything_moves());
  EXPECT_GE(Journal(folder_ / "run/journal.sqlite").scans().size(), 1u);
}

TEST_F(DeviceFaults, DriveThatGoesAwayStopsTheOthers) {
  Twin twin(folder_ / "cell.yaml");
  const ProcessResult broken = run_while([&] {
    wait_until([&] { return twin.frames >= 1; });
    twin.drives.erase(15121);
  });
  EXPECT_EQ(broken.exit_code, 3) << broken.out << broken.err;
  EXPECT_NE(broken.err.find("axis linear"), std::string::npos) << broken.err;
  EXPECT_NE(broken.err.find("127.0.0.1:15121"), std::string::npos) << broken.err;
}

TEST_F(DeviceFaults, TheEmergencyStopTakesTheTorqueAndTheRunGoesOnAfterItsRelease) {
  Twin twin(folder_ / "cell.yaml");
  const ProcessResult broken = run_while([&] {
    wait_until([&] { return twin.frames >= 1; });
    wait_until([&] { return twin.anything_moves(); });
    twin.contacts->press("emergency stop");
  });
  EXPECT_EQ(broken.exit_code, 3) << broken.out << broken.err;
  EXPECT_NE(broken.err.find("emergency stop is tripped"), std::string::npos) << broken.err;
  EXPECT_FALSE(twin.anything_moves());
  EXPECT_FALSE(twin.anything_has_torque());

  const ProcessResult refused = run_program("gantry-cell", run_arguments(true), 60);
  EXPECT_EQ(refused.exit_code, 3) << refused.out << refused.err;
  EXPECT_NE(refused.err.find("emergency stop is tripped"), std::string::npos) << refused.err;
  EXPECT_FALSE(twin.anything_has_torque());

  twin.contacts->release("emergency stop");
  const ProcessResult resumed = run_program("gantry-cell", run_arguments(true), 120);
  EXPECT_TRUE(resumed.exit_code == 0 || resumed.exit_code == 4) << resumed.out << resumed.err;
  EXPECT_EQ(Journal(folder_ / "run/journal.sqlite").scans().size(), 3u);
}

TEST_F(DeviceFaults, UnreachableDriveAndCameraAreNamed) {
  const ProcessResult nobody = run_program("gantry-cell", run_arguments(), 60);
  EXPECT_EQ(nobody.exit_code, 3);
  EXPECT_NE(nobody.err.find("axis linear"), std::string::npos) << nobody.err;
  EXPECT_NE(nobody.err.find("127.0.0.1:15121"), std::string::npos) << nobody.err;

  Twin twin(folder_ / "cell.yaml");
  twin.camera.reset();
  std::filesystem::remove_all(folder_ / "run");
  const ProcessResult blind = run_program("gantry-cell", run_arguments(), 60);
  EXPECT_EQ(blind.exit_code, 3);
  EXPECT_NE(blind.err.find("camera"), std::string::npos) << blind.err;
  EXPECT_NE(blind.err.find("127.0.0.71"), std::string::npos) << blind.err;
}

TEST_F(DeviceFaults, OperatorInterruptStopsTheStages) {
  Twin twin(folder_ / "cell.yaml");
  BackgroundProgram cell("gantry-cell", run_arguments());
  wait_until([&] { return twin.anything_moves(); });
  cell.send_signal(SIGINT);
  EXPECT_EQ(cell.wait(), 3);
  EXPECT_FALSE(twin.anything_moves());
}

TEST_F(DeviceFaults, StatusAndHomeAgainstTheTwin) {
  Twin twin(folder_ / "cell.yaml");
  const ProcessResult before = run_program("gantry-cell", {"status", "--cell", folder_ / "cell.yaml"}, 30);
  EXPECT_EQ(before.exit_code, 0) << before.err;
  EXPECT_NE(before.out.find("unknown"), std::string::npos) << before.out;
  const ProcessResult homed = run_program("gantry-cell", {"home", "--cell", folder_ / "cell.yaml"}, 60);
  EXPECT_EQ(homed.exit_code, 0) << homed.err;
  const ProcessResult after = run_program("gantry-cell", {"status", "--cell", folder_ / "cell.yaml"}, 30);
  EXPECT_EQ(after.out.find("unknown"), std::string::npos) << after.out;
}

TEST_F(DeviceFaults, AnAlarmIsShownRefusesMotionAndIsClearedByReset) {
  Twin twin(folder_ / "cell.yaml");
  const std::string cell = folder_ / "cell.yaml";
  twin.drives.at(15122)->raise_alarm(2, 0x30, AlarmCause::kPersists);
  const ProcessResult shown = run_program("gantry-cell", {"status", "--cell", cell}, 30);
  EXPECT_EQ(shown.exit_code, 3) << shown.out << shown.err;
  EXPECT_NE(shown.out.find("alarm 30h"), std::string::npos) << shown.out;
  EXPECT_NE(shown.out.find("ErrorStop"), std::string::npos) << shown.out;
  const ProcessResult refused = run_program("gantry-cell", {"home", "--cell", cell}, 30);
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_NE(refused.err.find("axis rotation"), std::string::npos) << refused.err;
  EXPECT_NE(refused.err.find("gantry-cell reset"), std::string::npos) << refused.err;
  EXPECT_FALSE(twin.anything_moves());

  const ProcessResult in_vain = run_program("gantry-cell", {"reset", "--cell", cell}, 30);
  EXPECT_EQ(in_vain.exit_code, 3) << in_vain.out << in_vain.err;
  EXPECT_NE(in_vain.err.find("persists"), std::string::npos) << in_vain.err;
  twin.drives.at(15122)->clear_alarm_cause(2);
  const ProcessResult cleared = run_program("gantry-cell", {"reset", "--cell", cell}, 30);
  EXPECT_EQ(cleared.exit_code, 0) << cleared.out << cleared.err;
  EXPECT_EQ(cleared.out.find("ErrorStop"), std::string::npos) << cleared.out;
  const ProcessResult homed = run_program("gantry-cell", {"home", "--cell", cell}, 60);
  EXPECT_EQ(homed.exit_code, 0) << homed.err;
}

}  // namespace
}  // namespace gantry::testing
