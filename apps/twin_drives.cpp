#include "twin_drives.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <map>

#include "gantry/foundation/error.h"
#include "gantry/foundation/strict_yaml.h"

namespace gantry {
namespace {

constexpr double kIaiMmPerCount = 0.01;

std::map<std::string, TwinSerialLine> read_serial_lines(const Cell& cell) {
  std::map<std::string, TwinSerialLine> lines;
  StrictYaml file = StrictYaml::load(cell.file);
  StrictYaml simulation = file.map("simulation");
  if (!simulation.has("serial")) return lines;
  for (StrictYaml& yaml : simulation.maps("serial")) {
    const std::string name = yaml.text("bus");
    const auto bus = std::find_if(cell.buses.begin(), cell.buses.end(),
                                  [&](const BusSettings& b) { return b.name == name; });
    if (bus == cell.buses.end() || !bus->serial())
      yaml.fail("bus", "there is no serial bus '" + name + "' in the list buses");
    TwinSerialLine line;
    line.link = yaml.path("link");
    line.baud = bus->line.baud;
    line.honest_wire_time = yaml.boolean_or("honest_wire_time", true);
    if (line.link != bus->line.device)
      yaml.fail("link", "the bus opens " + bus->line.device + "; the twin's line must be there");
    yaml.finish();
    if (!lines.emplace(name, line).second) yaml.fail("bus", "bus '" + name + "' is listed twice");
  }
  return lines;
}

class Servers {
 public:
  Servers(const Cell& cell, Clock& clock) : cell_(cell), clock_(clock), lines_(read_serial_lines(cell)) {}

  ModbusDriveServer& of(const DriveSettings& drive) {
    auto& server = servers_[drive.bus_key()];
    if (!server) server = make(drive);
    return *server;
  }

  std::vector<std::unique_ptr<ModbusDriveServer>> start() {
    std::vector<std::unique_ptr<ModbusDriveServer>> started;
    for (auto& [key, server] : servers_) {
      server->start();
      if (const auto line = lines_.find(key); line != lines_.end()) {
        spdlog::info("Modbus RTU on {} ({}), {} baud", line->second.link.string(), server->device(),
                     line->second.baud);
      } else {
        spdlog::info("Modbus TCP at {}", key);
      }
      started.push_back(std::move(server));
    }
    return started;
  }

 private:
  std::unique_ptr<ModbusDriveServer> make(const DriveSettings& drive) const {
    for (const BusSettings& bus : cell_.buses) {
      if (bus.name != drive.bus) continue;
      if (!bus.serial()) return std::make_unique<ModbusDriveServer>(bus.host, bus.port, clock_);
      const auto line = lines_.find(bus.name);
      if (line == lines_.end())
        throw InputError(cell_.file.string() + ": bus '" + bus.name +
                         "' is a serial line; list it in simulation.serial for the twin to serve it");
      return std::make_unique<ModbusDriveServer>(line->second, clock_);
    }
    return std::make_unique<ModbusDriveServer>(drive.host, drive.port, clock_);
  }

  const Cell& cell_;
  Clock& clock_;
  const std::map<std::string, TwinSerialLine> lines_;
  std::map<std::string, std::unique_ptr<ModbusDriveServer>> servers_;
};

}  // namespace

std::vector<std::unique_ptr<ModbusDriveServer>> serve_drives(const Cell& cell, SimulatedWorld& world,
                                                             const SafetyContacts* contacts, Clock& clock) {
  Servers servers(cell, clock);
  const auto& known = twin_drive_profiles();
  for (size_t i = 0; i < cell.axes.size(); ++i) {
    const AxisSettings& axis = cell.axes[i];
    const std::string where = cell.file.string() + ": axis '" + axis.name + "'";
    if (axis.drive.profile == "simulated")
      throw InputError(where + " is simulated in-process; the twin serves Modbus drives only");
    if (std::find(known.begin(), known.end(), axis.drive.profile) == known.end())
      throw InputError(where + ": the twin has no drive of profile '" + axis.drive.profile + "'");
    TwinDriveConfig config;
    config.profile = axis.drive.profile;
    config.unit = axis.drive.unit;
    config.axis_units_per_count =
        axis.drive.counts_per_axis_unit > 0 ? 1.0 / axis.drive.counts_per_axis_unit : kIaiMmPerCount;
    servers.of(axis.drive).add(config, world.stage(i));
  }
  if (contacts) {
    DriveSettings module;
    module.host = cell.safety->module.host;
    module.port = cell.safety->module.port;
    servers.of(module).add_io_module(cell.safety->module.unit, *contacts);
  }
  return servers.start();
}

}  // namespace gantry
