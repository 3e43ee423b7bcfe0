#pragma once

#include <cstdint>
#include <string>

#include "gantry/foundation/error.h"
#include "gantry/hal/drive.h"

namespace gantry {

/// Why an axis is in ErrorStop. A code, because it is found inside the control loop, where no text may be
/// made; describe() makes the text outside.
enum class AxisReason : uint8_t {
  kNone,
  kDriveFault,         ///< An exchange with the drive failed; the channel has the text.
  kAlarm,              ///< `code`: the drive's alarm code.
  kEmergencyStop,      ///< The drive reports it.
  kServoLost,          ///< The drive switched its servo off by itself.
  kServoDidNotComeOn,  ///< Within `limit` s.
  kHomingTimeout,      ///< Not homed within `limit` s.
  kHomingFailed,       ///< The drive ended homing without being homed.
  kNotArrived,         ///< Not at `limit` in time; it stands at `value`.
  kNotStopped,         ///< Still moving long after a stop.
  kFollowingError,     ///< `value` exceeded `limit` for too long.
  kLimitSwitch,        ///< `code` -1: the lower one, +1: the upper one.
  kSoftLimit,          ///< At `value`, beyond the soft limit `limit`.
  kDrift,              ///< Commanded to stand at `limit`, it is at `value`.
  kStaleData,          ///< The newest reading is `value` s old, `limit` s are allowed.
  kLoopStalled,        ///< The control loop stood still; the drive was halted meanwhile.
  kResetFailed,        ///< The cause persists after a reset; `code`: alarm, or 0.
  kQueueFull,          ///< The drive's channel takes no more commands.
  kOtherAxis,          ///< Axis number `code` failed.
  kSafety,             ///< The safety chain asked for stop category `code`.
  kOperator            ///< Stopped on request.
};

struct AxisError {
  AxisReason reason = AxisReason::kNone;
  int code = 0;
  double value = 0, limit = 0;  ///< Axis units or s.
};

/// What kind of Fault a reason is; `drive_fault` for kDriveFault.
FaultKind fault_kind(AxisReason reason, FaultKind drive_fault);

/// "12.50 mm" or "-30.00 deg", for a person.
std::string format_position(AxisKind kind, double position);

/// In words, without the axis' name. kDriveFault, kOtherAxis and kSafety say only what the code says.
std::string describe(const AxisError& error, AxisKind kind);

/// Why a command was not taken.
enum class AxisRefusal : uint8_t {
  kNone,
  kWrongState,
  kNotHomed,
  kSoftLimit,          ///< Target outside the soft limits.
  kOnLimitSwitch,      ///< Stands on a limit switch; only moves away from it are allowed.
  kCannotMoveUnhomed,  ///< The drive cannot move before homing.
  kNotANumber,         ///< Target, speed or acceleration is none, or not positive.
  kQueueFull,
  kSafety  ///< The safety chain does not permit motion.
};

}  // namespace gantry
