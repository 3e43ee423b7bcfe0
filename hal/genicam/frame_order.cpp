#include "frame_order.h"

namespace gantry {

namespace {

constexpr uint64_t kShortIds = 0xFFFF;  ///< Zero is not one of them.

/// The id nearest to `last` that shows as `short_id` on the wire.
uint64_t extend(uint64_t short_id, uint64_t last) {
  const uint64_t steps = (short_id + kShortIds - (last - 1) % kShortIds - 1) % kShortIds;
  const bool backwards = steps > kShortIds / 2 && last + steps > kShortIds;
  return last + steps - (backwards ? kShortIds : 0);
}

}  // namespace

std::optional<FrameOrder::Violation> FrameOrder::accept(uint64_t id, bool id_is_16_bit,
                                                        uint64_t timestamp_ns) {
  if (!last_) {
    last_ = Frame{id, timestamp_ns};
    triggers_since_last_ = 0;
    return std::nullopt;
  }
  const Frame before = *last_;
  if (id_is_16_bit) id = extend(id, before.id);
  if (id <= before.id) {
    return Violation{FaultKind::kProtocol, "frame " + std::to_string(id) + " came after frame " +
                                               std::to_string(before.id) +
                                               ": the camera repeated an old frame"};
  }
  if (timestamp_ns <= before.timestamp_ns) {
    return Violation{FaultKind::kProtocol, "the timestamp of frame " + std::to_string(id) + " is " +
                                               std::to_string(timestamp_ns) + " ns, not later than the " +
                                               std::to_string(before.timestamp_ns) +
                                               " ns of the frame before"};
  }
  const uint64_t expected = before.id + triggers_since_last_;
  last_ = Frame{id, timestamp_ns};
  triggers_since_last_ = 0;
  if (id != expected) {
    return Violation{FaultKind::kDataLoss, "frame " + std::to_string(id) + " came where frame " +
                                               std::to_string(expected) + " was due: a frame was lost"};
  }
  return std::nullopt;
}

}  // namespace gantry
