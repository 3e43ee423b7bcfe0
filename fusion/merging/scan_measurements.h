#pragma once

#include <memory>
#include <vector>

#include "gantry/fusion/range_surface.h"
#include "gantry/geometry/pose.h"
#include "merging/cell_grid.h"

namespace gantry::internal {

/// The usable pixels of one scan as measurements in the part frame, sorted by shard: strips of rows are
/// worked in parallel, each keeps its own lists, and within shard and strip the order is that of the pixels.
class ScanMeasurements {
 public:
  /// Forgets the scan before. Throws InputError when a point lies outside the grid's range.
  void unpack(const RangeSurface& surface, const Pose& part_from_sensor, double cell_mm);

  size_t size() const { return size_; }
  size_t bytes() const { return capacity_ * (sizeof(Measurement) + sizeof(uint32_t)); }

  void add_to(Shard& shard, size_t number, uint16_t scan) const {
    for (const Strip& strip : strips_)
      shard.add(
          &measurements_[strip.first],
          {&order_[strip.first + strip.begins[number]], &order_[strip.first + strip.begins[number + 1]]},
          scan);
  }

 private:
  struct Strip {
    size_t first = 0;  ///< Where its measurements begin in the buffers.
    std::array<uint32_t, kShards + 1> begins{};
    bool in_range = true;
  };

  size_t size_ = 0, capacity_ = 0;
  std::unique_ptr<Measurement[]> measurements_;
  std::unique_ptr<uint32_t[]> order_;  ///< Indices into the strip's measurements, by shard.
  std::vector<Strip> strips_;
};

}  // namespace gantry::internal
