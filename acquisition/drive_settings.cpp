#include "gantry/acquisition/drive_settings.h"

#include <algorithm>
#include <numbers>
#include <set>

#include "gantry/foundation/error.h"
#include "gantry/hal/drive_profile.h"

namespace gantry {
namespace {

SerialLine read_line(StrictYaml& yaml) {
  SerialLine line;
  line.device = yaml.path("device").string();
  line.baud = yaml.integer_or("baud", line.baud, 1, 10'000'000);
  if (yaml.has("parity")) {
    const std::string parity = yaml.choice("parity", {"none", "even", "odd"});
    line.parity = parity == "none" ? Parity::kNone : parity == "even" ? Parity::kEven : Parity::kOdd;
  }
  line.stop_bits = yaml.integer_or("stop_bits", line.stop_bits, 1, 2);
  line.read_attempts = yaml.integer_or("read_attempts", line.read_attempts, 1, 5);
  line.late_answer_s = yaml.number_or("late_answer_s", line.late_answer_s, {0, 60});
  try {
    (void)make_modbus_bus(line);  // opens nothing; refuses a rate that no line has
  } catch (const InputError& error) {
    yaml.fail("baud", error.what());
  }
  return line;
}

/// The name of a shipped profile, or the path of a file seen from the cell's.
std::string read_profile(StrictYaml& yaml) {
  const std::string profile = yaml.text("profile");
  if (profile == "simulated") return profile;
  const bool file = profile.find('/') != std::string::npos || profile.ends_with(".yaml");
  return file ? yaml.path("profile").string() : profile;
}

DriveProfileFacts facts_or_fail(StrictYaml& yaml, const std::string& profile) {
  try {
    return drive_profile_facts(profile);
  } catch (const InputError& error) {
    yaml.fail("profile", error.what());
  }
}

}  // namespace

std::vector<BusSettings> read_buses(StrictYaml& cell) {
  std::vector<BusSettings> buses;
  if (!cell.has("buses")) return buses;
  std::set<std::string> names, devices;
  for (StrictYaml& yaml : cell.maps("buses")) {
    BusSettings bus;
    bus.name = yaml.text("name");
    if (!names.insert(bus.name).second) yaml.fail("name", "two buses are called '" + bus.name + "'");
    if (yaml.has("host")) {
      bus.host = yaml.text("host");
      bus.port = yaml.integer_or("port", bus.port, 1, 65535);
    } else {
      bus.line = read_line(yaml);
      if (!devices.insert(bus.line.device).second)
        yaml.fail("device", "two buses have this device; a line has one owner");
    }
    yaml.finish();
    buses.push_back(std::move(bus));
  }
  return buses;
}

DriveSettings read_drive(StrictYaml yaml, AxisKind kind, const std::vector<BusSettings>& buses) {
  DriveSettings drive;
  drive.profile = read_profile(yaml);
  if (drive.profile == "simulated") {
    yaml.finish();
    return drive;
  }
  const DriveProfileFacts facts = facts_or_fail(yaml, drive.profile);
  const bool linear = kind == AxisKind::kLinear;
  if (linear ? !facts.linear : !facts.rotary)
    yaml.fail("profile",
              "a drive " + facts.model + " moves no " + (linear ? "prismatic" : "revolute") + " joint");

  if (yaml.has("bus")) {
    drive.bus = yaml.text("bus");
    if (std::none_of(buses.begin(), buses.end(), [&](const BusSettings& b) { return b.name == drive.bus; }))
      yaml.fail("bus", "there is no bus '" + drive.bus + "' in the list buses");
  } else {
    drive.host = yaml.text("host");
    drive.port = yaml.integer_or("port", drive.port, 1, 65535);
  }
  drive.unit = yaml.integer("unit", 1, 247);
  if (!facts.counts_fixed)
    drive.counts_per_axis_unit =
        linear ? yaml.number("steps_per_mm", {1e-3, 1e8})
               : yaml.number("steps_per_revolution", {100, 1e9}) / (2 * std::numbers::pi);
  if (facts.counts_motor_revolutions)
    drive.counts_per_motor_revolution = yaml.number_or("steps_per_motor_revolution", 0, {100, 1e6});
  yaml.finish();
  return drive;
}

}  // namespace gantry
