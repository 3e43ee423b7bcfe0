#include "gantry/hal/axis_error.h"

#include <cstdio>
#include <numbers>

namespace gantry {
namespace {

std::string seconds(double value_s) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g s", value_s);
  return text;
}

// Manuals list alarm codes in hexadecimal.
std::string alarm(int code) {
  char text[48];
  std::snprintf(text, sizeof text, "drive alarm %02Xh (%d)", static_cast<unsigned>(code), code);
  return text;
}

}  // namespace

FaultKind fault_kind(AxisReason reason, FaultKind drive_fault) {
  switch (reason) {
    case AxisReason::kDriveFault:
      return drive_fault;
    case AxisReason::kAlarm:
    case AxisReason::kResetFailed:
      return FaultKind::kAlarm;
    case AxisReason::kServoLost:
      return FaultKind::kProtocol;
    case AxisReason::kServoDidNotComeOn:
    case AxisReason::kHomingTimeout:
    case AxisReason::kStaleData:
    case AxisReason::kLoopStalled:
      return FaultKind::kTimeout;
    case AxisReason::kNotArrived:
    case AxisReason::kNotStopped:
    case AxisReason::kFollowingError:
    case AxisReason::kDrift:
      return FaultKind::kNotSettled;
    case AxisReason::kLimitSwitch:
    case AxisReason::kSoftLimit:
      return FaultKind::kLimit;
    default:
      return FaultKind::kRefused;
  }
}

std::string format_position(AxisKind kind, double position) {
  char text[48];
  const bool rotary = kind == AxisKind::kRotary;
  std::snprintf(text, sizeof text, "%.2f %s", rotary ? position * 180.0 / std::numbers::pi : position,
                rotary ? "deg" : "mm");
  return text;
}

std::string describe(const AxisError& error, AxisKind kind) {
  const auto position = [kind](double value) { return format_position(kind, value); };
  switch (error.reason) {
    case AxisReason::kNone:
      return "no error";
    case AxisReason::kDriveFault:
      return "an exchange with the drive failed";
    case AxisReason::kAlarm:
      return alarm(error.code);
    case AxisReason::kEmergencyStop:
      return "the emergency stop is active";
    case AxisReason::kServoLost:
      return "the drive switched its servo off by itself";
    case AxisReason::kServoDidNotComeOn:
      return "the servo did not switch on within " + seconds(error.limit);
    case AxisReason::kHomingTimeout:
      return "homing did not end within " + seconds(error.limit);
    case AxisReason::kHomingFailed:
      return "the drive ended homing without having found its home position; check the home switch";
    case AxisReason::kNotArrived:
      return "did not reach " + position(error.limit) + " in time; it stands at " + position(error.value);
    case AxisReason::kNotStopped:
      return "did not come to a standstill after stop";
    case AxisReason::kFollowingError:
      return "the following error of " + position(error.value) + " exceeds the allowed " +
             position(error.limit) + "; is the axis blocked, or the encoder loose?";
    case AxisReason::kLimitSwitch:
      return std::string("ran onto its ") + (error.code < 0 ? "lower" : "upper") + " limit switch";
    case AxisReason::kSoftLimit:
      return "is at " + position(error.value) + ", beyond its soft limit of " + position(error.limit);
    case AxisReason::kDrift:
      return "left its standstill at " + position(error.limit) + " without a command; it is at " +
             position(error.value);
    case AxisReason::kStaleData:
      return "no reading for " + seconds(error.value) + "; " + seconds(error.limit) + " are allowed";
    case AxisReason::kLoopStalled:
      return "the control loop stood still; the drive was halted meanwhile";
    case AxisReason::kResetFailed:
      return error.code != 0 ? alarm(error.code) + " persists after the reset"
                             : "the drive did not confirm the reset";
    case AxisReason::kQueueFull:
      return "the drive's channel takes no more commands";
    case AxisReason::kOtherAxis:
      return "stopped because another axis failed";
    case AxisReason::kSafety:
      return "stopped by the safety chain, stop category " + std::to_string(error.code);
    case AxisReason::kOperator:
      return "stopped on request";
  }
  return "unknown error";
}

}  // namespace gantry
