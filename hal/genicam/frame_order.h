#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {

/// Proves that each frame is the answer to the last trigger. Every trigger makes one frame, so the
/// next id is known beforehand: a smaller one is an old frame once more, a larger one means that a
/// frame in between was lost.
class FrameOrder {
 public:
  /// What is wrong: kProtocol (repeated, or time ran backwards) or kDataLoss (one in between is missing).
  struct Violation {
    FaultKind kind;
    std::string message;
  };

  void triggered() { ++triggers_since_last_; }

  /// Takes note of a complete frame. `id_is_16_bit`: GigE Vision's short block id, which runs
  /// 1, 2, ... 65535, 1.
  std::optional<Violation> accept(uint64_t id, bool id_is_16_bit, uint64_t timestamp_ns);

  /// Of the last accepted frame; continues counting where a short id starts again.
  uint64_t last_id() const { return last_ ? last_->id : 0; }

 private:
  struct Frame {
    uint64_t id;
    uint64_t timestamp_ns;
  };
  std::optional<Frame> last_;
  uint64_t triggers_since_last_ = 0;
};

}  // namespace gantry
