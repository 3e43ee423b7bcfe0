#pragma once

#include <string>

namespace gantry {

/// Stop categories of IEC 60204-1 (section 9.2.2): 0 is power off at once, 1 is a controlled stop and
/// then power off.
enum class StopCategory { kNone, kCategory0, kCategory1 };

/// Whether the cell may move. The supervisor asks in every cycle.
class MotionPermit {
 public:
  virtual ~MotionPermit() = default;
  /// Neither blocks nor allocates. `reset_requested` is true in the one cycle in which a person asks for a
  /// reset.
  virtual StopCategory required_stop(double now_s, bool reset_requested) = 0;
  /// In words, for the last answer. Any thread; may allocate.
  virtual std::string why() const = 0;
};

}  // namespace gantry
