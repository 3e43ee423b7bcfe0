#pragma once

#include <string>

namespace gantry {

/// What must happen to the motors, named as IEC 60204-1 (9.2.2 in the edition of 2016) names stops.
enum class StopCategory {
  kNone,       ///< No stop is required: motion is allowed.
  kCategory0,  ///< Torque off at once; the axes coast or are braked mechanically.
  kCategory1   ///< Ramp down under control, then torque off at standstill.
};

/// Asked in every cycle of the motion supervisor: whether anything outside of motion (the safety chain)
/// requires a stop. Must not block, and must not allocate memory in required_stop().
class MotionPermit {
 public:
  virtual ~MotionPermit() = default;
  /// `reset_requested` is the level of the operator's reset; what counts is its rising edge.
  virtual StopCategory required_stop(double now_s, bool reset_requested) = 0;
  /// Why a stop is required, for a person; from any thread, outside the cycle.
  virtual std::string why() const = 0;
};

}  // namespace gantry
