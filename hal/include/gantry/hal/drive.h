#pragma once

#include <optional>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {

enum class AxisKind { kLinear, kRotary };

/// Who the drive is, for messages and the record.
struct DriveInfo {
  std::string axis;     ///< Name of the axis it moves: "tilt".
  std::string model;    ///< "IAI ROBO Cylinder", "Oriental Motor AZ", "simulated".
  std::string address;  ///< "127.0.0.1:1503 unit 2"; empty for a device in this process.

  /// "axis tilt (Oriental Motor AZ at 127.0.0.1:1503 unit 2)".
  std::string text() const;
};

/// One reading of a drive. Positions in axis units: mm (linear) or rad (rotary).
struct DriveStatus {
  double position = 0;    ///< From the encoder; means nothing before homing.
  bool servo_on = false;  ///< The motor holds its position.
  bool homed = false;
  bool moving = false;
  bool in_position = false;  ///< The drive's own opinion that the last move has ended at its target.
  bool emergency_stop = false;
  std::optional<int> alarm;               ///< The drive's alarm code while one is pending.
  std::optional<double> following_error;  ///< Commanded minus actual position, where the drive tells it.
  bool lower_limit = false, upper_limit = false;  ///< Hard limit switches as the drive sees them.
  double sampled_at_s = 0;                        ///< By the injected clock.
};

struct MoveCommand {
  double target = 0;        ///< mm or rad, absolute.
  double speed = 0;         ///< mm/s or rad/s, positive.
  double acceleration = 0;  ///< mm/s^2 or rad/s^2, positive.
};

/// What a motor drive can do, and no more: each call is one short exchange that starts something and
/// returns; nothing here waits for motion to end. The rules (what is allowed in which state, soft
/// limits, homing first) are Axis's, one implementation for all drives.
class Drive {
 public:
  virtual ~Drive() = default;
  virtual const DriveInfo& info() const = 0;
  /// Opens the connection if it is not open, and checks that the expected drive answers.
  virtual Result<void> connect() = 0;
  virtual Result<DriveStatus> read_status() = 0;
  virtual Result<void> set_servo(bool on) = 0;
  virtual Result<void> start_homing() = 0;
  virtual Result<void> start_move(const MoveCommand& command) = 0;
  /// Decelerates to standstill; the motor stays under power.
  virtual Result<void> halt() = 0;
  virtual Result<void> reset_alarm() = 0;
  /// The drive stops by itself when it hears nothing for so long; 0 switches that off. A drive that
  /// cannot returns a Fault kRefused with the words "has no communication time-out".
  virtual Result<void> set_communication_timeout(double /*timeout_s*/) {
    return fault(FaultKind::kRefused, info().text(), "has no communication time-out");
  }
  /// Whether start_move() works before homing, in the encoder's own coordinates; jogging then needs it.
  virtual bool moves_unhomed() const { return false; }
};

}  // namespace gantry
