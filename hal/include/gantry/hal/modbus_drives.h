#pragma once

#include <memory>
#include <string>

#include "gantry/foundation/clock.h"
#include "gantry/hal/drive.h"

namespace gantry {

/// One TCP connection to a Modbus drive or to a gateway with several units behind it.
class ModbusBus;

/// A bus that several drives share: one connection, one exchange at a time. Opens nothing yet.
std::shared_ptr<ModbusBus> make_modbus_bus(const std::string& host, int port);

/// A motor drive that speaks Modbus TCP (or RTU behind a gateway). docs/modbus-drives.md has the
/// registers.
struct ModbusDriveConfig {
  std::string axis;  ///< Name for messages: "tilt".
  AxisKind kind = AxisKind::kLinear;
  /// "iai_robo_cylinder": linear; numerical movement command (IAI "ROBO Cylinder Series, Modbus").
  /// "oriental_motor_az": linear or rotary; direct data operation (Oriental Motor HM-60262E).
  std::string profile;
  std::string host;  ///< Address or name.
  int port = 502;
  int unit = 1;  ///< Modbus unit, 1 to 247; for IAI the axis number plus one.
  /// Oriental Motor: motor steps per mm or per rad of the axis, gear and electronic gear included.
  /// IAI: fixed by the drive at 100 counts per mm, leave at 0.
  double counts_per_axis_unit = 0;
  /// IAI: the band that the drive is told to call "in position". Oriental Motor: set in the drive.
  double in_position_mm = 0.05;
  double response_timeout_s = 0.3;  ///< For one exchange, reopening the connection included.
};

/// `bus` may be null: the drive then has a connection of its own. Throws InputError when the
/// configuration cannot be right. Opens nothing yet: connect() does, and fails within about a second
/// where nobody answers. A connection that is lost is opened again by the next call.
std::unique_ptr<Drive> make_modbus_drive(const ModbusDriveConfig& config, std::shared_ptr<ModbusBus> bus,
                                         Clock& clock);

}  // namespace gantry
