#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/sim/safety_contacts.h"
#include "gantry/sim/stage.h"
#include "gantry/sim/twin/wire_faults.h"

namespace gantry {

/// One simulated motor drive on a Modbus endpoint.
struct TwinDriveConfig {
  std::string profile;  ///< One of twin_drive_profiles().
  int unit = 1;         ///< Modbus unit (slave) 1 to 247; IAI: axis number + 1.
  /// Axis units (mm or rad) of one count. The IAI drive counts 0.01 mm whatever its lead, so nothing else
  /// is accepted there; for the others it is the travel of one step, pulse or encoder count behind the gear.
  double axis_units_per_count = 0.01;
  /// Oriental Motor AZ only: where it has its communication time-out (upper word's address, milliseconds). No
  /// source that this project could read says where it is, so that tests choose; 0: nowhere.
  int communication_timeout_address = 0;
};

/// "iai_robo_cylinder", "kinco_fd", "leadshine_cs2rs", "oriental_motor_az".
const std::vector<std::string>& twin_drive_profiles();

/// A serial line of the twin, which is a pseudo-terminal.
struct TwinSerialLine {
  std::filesystem::path link;  ///< A symbolic link to it that is made, and replaced if it is there; or empty.
  int baud = 115200;
  bool honest_wire_time = true;  ///< Replies take as long as their bytes and the request's need at that rate.
};

/// Whether the cause of an injected alarm stays, so that a reset brings the alarm back at once.
enum class AlarmCause { kGone, kPersists };

/// An endpoint with real drives behind it, Modbus TCP (then it behaves like an RTU gateway) or Modbus RTU on
/// a serial line: register maps and alarms of each drive, motion by SimulatedStage. The wire contract, with
/// its sources and with what could not be checked, is docs/modbus-drives.md.
///
/// Serves any number of units, on TCP to several clients, from a thread of its own. Public functions may be
/// called from any thread; the injection ones throw InputError for a unit that was not added. Time is the
/// given clock's: with a VirtualClock nothing moves until somebody sleeps on it. Only the wire is in real
/// time.
class ModbusDriveServer {
 public:
  /// `address` must be a loopback one (127.x.y.z), else InputError. Port 0 takes a free one.
  ModbusDriveServer(std::string address, int port, Clock& clock);
  ModbusDriveServer(const TwinSerialLine& line, Clock& clock);
  /// Closes every connection and joins the thread, at once.
  ~ModbusDriveServer();
  ModbusDriveServer(const ModbusDriveServer&) = delete;
  ModbusDriveServer& operator=(const ModbusDriveServer&) = delete;

  /// Powers up a drive on `stage`, which must outlive the server. Throws InputError for an unknown profile, a
  /// unit that is taken or out of range, or a count that is not positive.
  void add(const TwinDriveConfig& config, SimulatedStage& stage);
  /// Puts an I/O module with 16 discrete inputs (function 02) on the bus, wired to `contacts`, which must
  /// outlive the server. Throws InputError for a unit that is taken or out of range.
  void add_io_module(int unit, const SafetyContacts& contacts);

  /// Binds and serves. Throws InputError naming what cannot be had.
  void start();
  /// The port that is served; 0 before start() if an ephemeral one was asked for, and on a serial line.
  int port() const;
  /// The device of the serial line ("/dev/pts/3"); empty on TCP, before start() and while unplugged.
  std::string device() const;

  // Fault injection: the drives.
  void raise_alarm(int unit, int code, AlarmCause cause = AlarmCause::kGone);
  /// Removes a persisting cause; the alarm itself stays until the client resets it.
  void clear_alarm_cause(int unit);
  /// IAI: status b15, servo off. AZ: HWTO input, alarm 68h. CS2RS: quick stop input, power off. Kinco:
  /// hardware lock, power off. Releasing it does not reset anything.
  void set_emergency_stop(int unit, bool active);

  // Fault injection: the wire.
  WireFaults& wire_faults();
  /// False: every connection ends and none is accepted, or the serial device is gone (its link too), until it
  /// is true again. Returns when it is done.
  void set_plugged(bool plugged);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
