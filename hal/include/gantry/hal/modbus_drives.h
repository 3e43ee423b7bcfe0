#pragma once

#include <memory>
#include <string>

#include "gantry/foundation/clock.h"
#include "gantry/hal/bus_statistics.h"
#include "gantry/hal/drive.h"

namespace gantry {

/// A Modbus bus that several drives share: one owner of the connection or line, a queue before it.
class ModbusBus;

enum class Parity { kNone, kEven, kOdd };

/// A serial line with Modbus RTU drives on it (8 data bits).
struct SerialLine {
  std::string device;  ///< "/dev/ttyUSB0", or a pty.
  int baud = 115200;   ///< 9600, 19200, 38400, 57600, 115200 or 230400.
  Parity parity = Parity::kEven;
  int stop_bits = 1;      ///< 1 or 2.
  int read_attempts = 2;  ///< How often a read (or a write that may be repeated) is sent at most, 1 to 5.
  /// After an answer that did not come, a drive that does not answer function 08 either is left alone for
  /// this long: no answer may come later.
  double late_answer_s = 1.0;
};

/// A bus over TCP: one connection to a drive or to a gateway with several units behind it. Opens nothing yet.
std::shared_ptr<ModbusBus> make_modbus_bus(const std::string& host, int port);
/// A bus over a serial line. Throws InputError for settings that no line has. Opens nothing yet.
std::shared_ptr<ModbusBus> make_modbus_bus(const SerialLine& line);

/// "127.0.0.1:1503" or "/dev/ttyUSB0".
std::string modbus_bus_address(const ModbusBus& bus);
BusStatistics modbus_bus_statistics(const ModbusBus& bus);

/// A motor drive that speaks Modbus. docs/modbus-drives.md has the registers.
struct ModbusDriveConfig {
  std::string axis;  ///< Name for messages: "tilt".
  AxisKind kind = AxisKind::kLinear;
  /// A shipped drive profile, "iai_robo_cylinder", or the path of a profile file (drive_profile.h).
  std::string profile;
  std::string host;  ///< Address or name; not needed with a bus.
  int port = 502;
  int unit = 1;  ///< Modbus unit, 1 to 247; for IAI the axis number plus one.
  /// Counts (steps, pulses) per mm or per rad of the axis, gear and electronic gear included. 0 where the
  /// profile fixes it (IAI: 100 per mm).
  double counts_per_axis_unit = 0;
  /// Counts of one revolution of the motor; 0: as in the profile. Only for drives that count speed in rpm.
  double counts_per_motor_revolution = 0;
  /// Band around the target that counts as arrived, mm or rad. IAI: the drive is told it.
  double in_position = 0.05;
  double response_timeout_s = 0.3;  ///< For one attempt, reopening the connection included.
};

/// `bus` may be null: the drive then has a TCP connection of its own. Throws InputError when the
/// configuration cannot be right. Opens nothing yet: connect() does, and fails within about a second
/// where nobody answers. A connection that is lost is opened again by the next call.
std::unique_ptr<Drive> make_modbus_drive(const ModbusDriveConfig& config, std::shared_ptr<ModbusBus> bus,
                                         Clock& clock);

}  // namespace gantry
