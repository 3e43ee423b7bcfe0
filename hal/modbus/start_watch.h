#pragma once

#include <optional>

namespace gantry {

/// Between a start command and the first moment at which the drive shows its effect, the status still
/// tells of the motion before: at rest, homed, in position. Taken at its word, a move would be over
/// before it began. This watch says whether the command has begun to show: on evidence in the status
/// word or, for motions that are over between two readings, after a time by which every drive has
/// reacted.
class StartWatch {
 public:
  void commanded(double now_s) { commanded_at_s_ = now_s; }
  void forget() { commanded_at_s_.reset(); }

  /// Still waiting for the effect of the last command; `evidence` ends the wait.
  bool pending(bool evidence, double now_s) {
    if (evidence || (commanded_at_s_ && now_s - *commanded_at_s_ > kWindow_s)) forget();
    return commanded_at_s_.has_value();
  }

 private:
  static constexpr double kWindow_s = 0.2;
  std::optional<double> commanded_at_s_;
};

}  // namespace gantry
