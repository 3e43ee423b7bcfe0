#pragma once

#include <string>
#include <vector>

#include "gantry/foundation/strict_yaml.h"
#include "gantry/hal/modbus_drives.h"

namespace gantry {

/// A bus that drives of a cell name: a serial line, or a TCP endpoint.
struct BusSettings {
  std::string name;
  SerialLine line;   ///< With an empty device: it is TCP.
  std::string host;  ///< TCP only.
  int port = 502;

  bool serial() const { return !line.device.empty(); }
};

/// How one axis is reached.
struct DriveSettings {
  std::string profile;  ///< "simulated", the name of a shipped drive profile, or the path of a profile file.
  std::string bus;      ///< A name of the cell's buses; empty: host and port.
  std::string host;
  int port = 502;
  int unit = 1;
  /// Steps (counts, pulses) per mm or rad of the load, after any gear; 0 where the profile fixes it.
  double counts_per_axis_unit = 0;
  double counts_per_motor_revolution = 0;  ///< 0: as in the profile.

  /// What two drives share that must have different units: "rs485" or "127.0.0.1:502".
  std::string bus_key() const { return bus.empty() ? host + ":" + std::to_string(port) : bus; }
};

/// The section `buses:` of CELL.yaml, which may be missing.
std::vector<BusSettings> read_buses(StrictYaml& cell);
/// The section `drive:` of an axis.
DriveSettings read_drive(StrictYaml yaml, AxisKind kind, const std::vector<BusSettings>& buses);

}  // namespace gantry
