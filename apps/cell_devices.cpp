#include "cell_devices.h"

#include <algorithm>
#include <map>

#include "gantry/foundation/strict_yaml.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/hal/genicam_scanner.h"
#include "gantry/sim/devices.h"

namespace gantry {
namespace {

bool on_loopback(const std::string& host) {
  return host.rfind("127.", 0) == 0 || host == "localhost";
}

/// Sets `simulated` where the bus leads to a twin: to this machine, or to a pseudo-terminal.
std::shared_ptr<ModbusBus> make_bus(const Cell& cell, const DriveSettings& drive, bool& simulated) {
  for (const BusSettings& bus : cell.buses) {
    if (bus.name != drive.bus) continue;
    if (!bus.serial()) {
      simulated = simulated || on_loopback(bus.host);
      return make_modbus_bus(bus.host, bus.port);
    }
    std::error_code ignored;
    const std::string device = std::filesystem::weakly_canonical(bus.line.device, ignored).string();
    simulated = simulated || device.rfind("/dev/pts/", 0) == 0;
    return make_modbus_bus(bus.line);
  }
  simulated = simulated || on_loopback(drive.host);
  return make_modbus_bus(drive.host, drive.port);
}

std::unique_ptr<Drive> make_drive(const AxisSettings& axis, std::shared_ptr<ModbusBus> bus, Clock& clock) {
  ModbusDriveConfig config;
  config.axis = axis.name;
  config.kind = axis.kind;
  config.profile = axis.drive.profile;
  config.unit = axis.drive.unit;
  config.counts_per_axis_unit = axis.drive.counts_per_axis_unit;
  config.counts_per_motor_revolution = axis.drive.counts_per_motor_revolution;
  config.in_position = axis.limits.in_position;
  return make_modbus_drive(config, std::move(bus), clock);
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

namespace {

/// Reads the inputs when it is time to.
std::function<void()> polled(std::shared_ptr<SafetyInputsChannel> channel, double interval_s, Clock& clock) {
  return [channel = std::move(channel), interval_s, &clock, due_s = clock.now_s()]() mutable {
    if (clock.now_s() < due_s) return;
    due_s = clock.now_s() + interval_s;
    channel->service();
  };
}

}  // namespace

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
  std::map<std::string, std::shared_ptr<ModbusBus>> buses;
  std::map<std::string, size_t> bus_numbers;  // axes on one bus share its I/O thread
  std::vector<std::unique_ptr<Axis>> axes;
  MotionOptions options{cell.supervisor, cell.drive_timeout_s, threads, {}, {}};
  for (size_t i = 0; i < cell.axes.size(); ++i) {
    const AxisSettings& settings = cell.axes[i];
    std::unique_ptr<Drive> drive;
    if (settings.drive.profile == "simulated") {
      drive = make_simulated_drive(settings.name, *devices.world, i);
      options.bus_of_axis.push_back(cell.axes.size() + i);
    } else {
      auto& bus = buses[settings.drive.bus_key()];
      if (!bus) {
        bus = make_bus(cell, settings.drive, devices.simulated);
        devices.buses.push_back(bus);
      }
      drive = make_drive(settings, bus, clock);
      options.bus_of_axis.push_back(bus_numbers.emplace(settings.drive.bus_key(), i).first->second);
    }
    axes.push_back(std::make_unique<Axis>(std::move(drive), settings.kind, settings.limits, clock));
  }
  if (cell.safety) {
    // Behind the gateway of some drives, the I/O module shares their bus and its thread.
    const std::string key = cell.safety->module.host + ":" + std::to_string(cell.safety->module.port);
    const auto bus = buses.find(key);
    devices.safety = make_safety_devices(*cell.safety, bus == buses.end() ? nullptr : bus->second, clock);
    const size_t number = bus == buses.end() ? 2 * cell.axes.size() : bus_numbers.at(key);
    auto service = polled(devices.safety.channel, cell.safety->poll_s, clock);
    if (!threads)  // Whoever only looks judges the chain, and must not stop anything by it.
      service = [service, permit = devices.safety.permit.get(), &clock] {
        service();
        permit->required_stop(clock.now_s(), false);
      };
    options.services.push_back({number, std::move(service)});
  }
  devices.motion = std::make_unique<Motion>(std::move(axes), cell.axes, options, clock,
                                            threads ? devices.safety.permit.get() : nullptr);
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
