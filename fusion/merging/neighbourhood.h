#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "merging/cell_grid.h"

namespace gantry::internal {

/// A cell as its neighbours see it; lengths in units of the cell's edge.
struct NearCell {
  Eigen::Vector3f position;  ///< From the corner of the block.
  Eigen::Vector3f normal;    ///< Unit.
  Cell* cell = nullptr;
  uint32_t count = 0;  ///< As in the cell, at hand.
  uint32_t scans = 0;
  int voxel = 0;    ///< Which of those gathered.
  int place = 0;    ///< In the list of its voxel.
  uint64_t id = 0;  ///< Unique, and the same in every run.
};

/// The cells of one block and of the voxels around it, unpacked and sorted by voxel.
class Neighbourhood {
 public:
  /// Of block `b` of a shard; forgets what was there before.
  void gather(CellGrid& grid, const Block& block);

  /// Calls `use(cell)` for all cells of the block itself.
  template <class Use>
  void for_own(Use&& use) const {
    for (int x = 0; x < kBlockEdge; ++x)
      for (int y = 0; y < kBlockEdge; ++y)
        for (const NearCell& cell : column(x, y, 0, kBlockEdge)) use(cell);
  }
  /// Calls `use(cell)` for all cells in the voxel of one of the block's own and in the 26 around it.
  template <class Use>
  void for_near(const NearCell& own, Use&& use) const {
    const int x = own.voxel / (kEdge * kEdge) - 1, y = own.voxel / kEdge % kEdge - 1,
              z = own.voxel % kEdge - 1;
    for (int dx = -1; dx <= 1; ++dx)
      for (int dy = -1; dy <= 1; ++dy)
        for (const NearCell& cell : column(x + dx, y + dy, z - 1, z + 2)) use(cell);
  }
  /// Where `other` lies from `own`, as a number from 0 to 26; 26 - k is the way back, 13 the same voxel.
  static int step_number(const NearCell& own, const NearCell& other) {
    constexpr int kFirst = kEdge * kEdge + kEdge + 1;
    const int d = other.voxel - own.voxel + kFirst;
    return 9 * (d / (kEdge * kEdge)) + 3 * (d / kEdge % kEdge) + d % kEdge;
  }
  static Eigen::Vector3i step(int k) { return {k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1}; }

 private:
  /// Voxels (x, y, from) to (x, y, to - 1); coordinates from -1 to kBlockEdge.
  std::span<const NearCell> column(int x, int y, int from, int to) const {
    const int i = ((x + 1) * kEdge + y + 1) * kEdge + 1;
    return {cells_.data() + begins_[i + from], cells_.data() + begins_[i + to]};
  }

  static constexpr int kEdge = kBlockEdge + 2;
  std::vector<NearCell> cells_;
  std::array<uint32_t, kEdge * kEdge * kEdge + 1> begins_{};
};

}  // namespace gantry::internal
