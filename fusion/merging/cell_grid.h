#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "merging/paged_array.h"

namespace gantry::internal {

/// Where a cell lies: its integer coordinates in units of the cell's edge, |coordinate| < kCellRange.
/// 4 x 4 x 4 cells are a block, which is what is looked up; 4 x 4 x 4 blocks go to the same shard.
using CellIndex = Eigen::Vector3i;
inline constexpr int kCellRange = 1 << 20;
inline constexpr int kBlockEdge = 4;
inline constexpr size_t kShards = 64;

/// 57 bits: 19 for each coordinate of the block, and 6 more for the cell in it.
inline uint64_t block_key(int x, int y, int z) {
  constexpr int kHalf = kCellRange / kBlockEdge;
  return static_cast<uint64_t>(x + kHalf) << 38 | static_cast<uint64_t>(y + kHalf) << 19 |
         static_cast<uint64_t>(z + kHalf);
}
inline uint64_t cell_key(const CellIndex& c) {
  return block_key(c.x() >> 2, c.y() >> 2, c.z() >> 2) << 6 |
         static_cast<uint64_t>((c.x() & 3) << 4 | (c.y() & 3) << 2 | (c.z() & 3));
}
inline Eigen::Vector3i block_of_key(uint64_t key) {
  constexpr int kHalf = kCellRange / kBlockEdge;
  constexpr uint64_t kMask = (1 << 19) - 1;
  return Eigen::Vector3i(static_cast<int>(key >> 38 & kMask), static_cast<int>(key >> 19 & kMask),
                         static_cast<int>(key & kMask)) -
         Eigen::Vector3i::Constant(kHalf);
}
inline size_t shard_of_block(uint64_t key) {
  constexpr uint64_t kCoarse = 0x1FFFF;  // without the lowest two bits of a coordinate
  const uint64_t coarse = key & (kCoarse << 40 | kCoarse << 21 | kCoarse << 2);
  return static_cast<size_t>(coarse * 0x9E3779B97F4A7C15u >> 58);
}
static_assert(kShards == 64);

/// A vector in fixed point, components up to 1 in 15 bits and sign. For a position a step is 1 / 32767 of the
/// cell's edge: 6 nm for a cell of 0.2 mm, far below the noise and what a float holds 1 m from the origin.
struct Fixed3 {
  int16_t x = 0, y = 0, z = 0;
  static constexpr float kUnit = 32767;
  Eigen::Vector3f value() const { return Eigen::Vector3f(x, y, z) * (1 / kUnit); }
};
inline Fixed3 to_fixed(const Eigen::Vector3f& v) {
  const auto round = [](float a) { return static_cast<int16_t>(a * Fixed3::kUnit + (a < 0 ? -0.5f : 0.5f)); };
  return {round(v.x()), round(v.y()), round(v.z())};
}

/// One measurement in the part frame, ready to be added.
struct Measurement {
  uint64_t cell = 0;  ///< cell_key
  Fixed3 offset;      ///< From the cell's middle, in units of its edge.
  Fixed3 normal;
  float weight = 0;  ///< 1 / sigma^2, 1/mm^2
};

/// What one scan gave to a cell.
struct Contribution {
  float weight = 0;   ///< Sum, 1/mm^2
  uint32_t next = 0;  ///< Of the scan before it, one-based in the shard; 0: none.
  uint16_t scan = 0;
};

/// The measurements of one voxel whose normals agree.
struct Cell {
  Fixed3 offset;        ///< Weighted mean from the voxel's middle, in units of its edge.
  Fixed3 normal;        ///< Weighted mean; shorter than 1 where normals differ.
  float weight = 0;     ///< Sum, 1/mm^2
  uint32_t count = 0;   ///< Measurements.
  uint32_t next = 0;    ///< Another cell of the same voxel, one-based in the shard; 0: none.
  uint32_t latest = 0;  ///< Its latest Contribution, one-based in the shard.
  uint16_t tag = 0;     ///< While adding: the latest scan, to count scans. Afterwards: a Fate.
  uint8_t scans = 0;    ///< That contributed, at most 255.
  uint8_t mark = 0;     ///< For the steps of cell_fates.h.
};
static_assert(sizeof(Cell) == 32);

struct Block {
  uint64_t key = 0;
  std::array<uint32_t, 64> first{};  ///< The first cell of each voxel, one-based in the shard; 0: empty.
};

/// A part of space with its blocks; shards are filled independently of each other.
class Shard {
 public:
  /// Adds `all[i]` for each i of `which`, in that order.
  void add(const Measurement* all, std::span<const uint32_t> which, uint16_t scan);
  const Block* find(uint64_t key) const;
  void release();

  PagedArray<Block> blocks;
  PagedArray<Cell> cells;
  PagedArray<Contribution> contributions;
  size_t bytes() const {
    return blocks.bytes() + cells.bytes() + contributions.bytes() + table_.size() * sizeof(uint32_t);
  }

  /// Calls `use(contribution)` for every scan of a cell, the latest first.
  template <class Use>
  void for_contributions(const Cell& cell, Use&& use) const {
    for (uint32_t link = cell.latest; link != 0; link = contributions[link - 1].next)
      use(contributions[link - 1]);
  }
  /// What `other`, a cell of the shard `its`, was given counts as given to `cell`.
  void take_contributions(Cell& cell, const Shard& its, const Cell& other);

 private:
  void accumulate(Cell& cell, const Measurement& m, uint16_t scan);
  size_t slot_of(uint64_t key) const;
  Block& block(uint64_t key);
  void enlarge_table();

  std::vector<uint32_t> table_;  ///< Open addressing; one-based indices of blocks.
};

using CellGrid = std::array<Shard, kShards>;

/// Normals that differ by less than 45 degrees belong to one surface.
inline constexpr float kSameSurfaceCosine = 0.70710678f;
/// Of one voxel, at most; more directions are noise and join the nearest.
inline constexpr int kMaxCellsOfVoxel = 8;

}  // namespace gantry::internal
