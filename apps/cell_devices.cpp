#include "cell_devices.h"

#include <algorithm>
#include <map>
#include <numbers>

#include "gantry/foundation/strict_yaml.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/hal/genicam_scanner.h"
#include "gantry/hal/modbus_drives.h"
#include "gantry/sim/devices.h"

namespace gantry {
namespace {

bool on_loopback(const std::string& host) {
  return host.rfind("127.", 0) == 0 || host == "localhost";
}

}  // namespace

std::unique_ptr<SimulatedWorld> make_world(const Cell& cell, const std::optional<std::filesystem::path>& part,
                                           uint64_t seed, Clock& clock) {
  StrictYaml yaml = StrictYaml::load(cell.file);
  const SimulationSettings settings = read_simulation(yaml.map("simulation"), cell.chain);
  const TriangleMesh mesh = read_mesh(part.value_or(settings.part));
  std::optional<TriangleMesh> holder;
  if (!settings.holder.empty()) holder = read_mesh(settings.holder);
  return std::make_unique<SimulatedWorld>(cell.chain, settings, mesh, holder, seed, clock);
}

CellDevices make_devices(const Cell& cell, const std::optional<std::filesystem::path>& part, uint64_t seed,
                         Clock& clock, bool threads) {
  CellDevices devices;
  const bool needs_world = cell.scanner.kind == "simulated" ||
                           std::any_of(cell.axes.begin(), cell.axes.end(),
                                       [](const AxisSettings& a) { return a.drive.profile == "simulated"; });
  if (needs_world) {
    devices.world = make_world(cell, part, seed, clock);
    devices.simulated = true;
  }
  std::map<std::pair<std::string, int>, std::shared_ptr<ModbusBus>> buses;
  std::map<std::pair<std::string, int>, size_t> bus_numbers;  // axes on one bus share its I/O thread
  std::vector<std::unique_ptr<Axis>> axes;
  MotionOptions options{cell.supervisor, cell.drive_timeout_s, threads, {}, {}};
  for (size_t i = 0; i < cell.axes.size(); ++i) {
    const AxisSettings& settings = cell.axes[i];
    std::unique_ptr<Drive> drive;
    if (settings.drive.profile == "simulated") {
      drive = make_simulated_drive(settings.name, *devices.world, i);
      options.bus_of_axis.push_back(cell.axes.size() + i);
    } else {
      ModbusDriveConfig config;
      config.axis = settings.name;
      config.kind = settings.kind;
      config.profile = settings.drive.profile;
      config.host = settings.drive.host;
      config.port = settings.drive.port;
      config.unit = settings.drive.unit;
      if (settings.drive.steps_per_revolution > 0)
        config.counts_per_axis_unit = settings.drive.steps_per_revolution / (2 * std::numbers::pi);
      if (settings.kind == AxisKind::kLinear) config.in_position_mm = settings.limits.in_position;
      auto& bus = buses[{config.host, config.port}];
      if (!bus) bus = make_modbus_bus(config.host, config.port);
      options.bus_of_axis.push_back(
          bus_numbers.emplace(std::pair{config.host, config.port}, i).first->second);
      drive = make_modbus_drive(config, bus, clock);
      devices.simulated = devices.simulated || on_loopback(config.host);
    }
    axes.push_back(std::make_unique<Axis>(std::move(drive), settings.kind, settings.limits, clock));
  }
  devices.motion = std::make_unique<Motion>(std::move(axes), cell.axes, options, clock);
  devices.axes_in_process = buses.empty();
  if (cell.scanner.kind == "simulated") {
    devices.scanner = make_simulated_scanner(*devices.world);
  } else {
    GenicamScannerConfig config;
    config.address = cell.scanner.address;
    devices.scanner = make_genicam_scanner(config, clock);
    devices.simulated = devices.simulated || on_loopback(config.address);
  }
  return devices;
}

}  // namespace gantry
