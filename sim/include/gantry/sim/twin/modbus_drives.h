#pragma once

#include <memory>
#include <string>

#include "gantry/foundation/clock.h"
#include "gantry/sim/safety_contacts.h"
#include "gantry/sim/stage.h"

namespace gantry {

/// One simulated motor drive on a Modbus endpoint.
struct TwinDriveConfig {
  std::string profile;  ///< "iai_robo_cylinder" or "oriental_motor_az".
  int unit = 1;         ///< Modbus unit (slave) 1 to 247; IAI: axis number + 1.
  /// Axis units (mm or rad) of one count. The IAI drive counts 0.01 mm whatever its lead, so nothing else
  /// is accepted there; for the AZ it is the angle of one step behind the gear.
  double axis_units_per_count = 0.01;
};

/// Whether the cause of an injected alarm stays, so that a reset brings the alarm back at once.
enum class AlarmCause { kGone, kPersists };

/// A Modbus TCP endpoint that behaves like an RTU gateway with real drives behind it: register maps and
/// alarms of the IAI ROBO Cylinder and of the Oriental Motor AZ, motion by SimulatedStage. The wire
/// contract, with its sources and with what could not be checked, is docs/modbus-drives.md; "homed" is status
/// b4 (HEND) of the first and output b4 (ABSPEN) of the second.
///
/// Serves any number of units to several clients from a thread of its own. Public functions may be
/// called from any thread; the injection ones throw InputError for a unit that was not added. Time is the
/// given clock's: with a VirtualClock nothing moves until somebody sleeps on it.
class ModbusDriveServer {
 public:
  /// `address` must be a loopback one (127.x.y.z), else InputError. Port 0 takes a free one.
  ModbusDriveServer(std::string address, int port, Clock& clock);
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

  /// Binds and serves. Throws InputError naming address and port when the port cannot be had.
  void start();
  /// The port that is served; 0 before start() if an ephemeral one was asked for.
  int port() const;

  // Fault injection.
  void raise_alarm(int unit, int code, AlarmCause cause = AlarmCause::kGone);
  /// Removes a persisting cause; the alarm itself stays until the client resets it.
  void clear_alarm_cause(int unit);
  /// IAI: status b15, servo off. AZ: HWTO input, alarm 68h. Releasing it does not reset anything.
  void set_emergency_stop(int unit, bool active);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
