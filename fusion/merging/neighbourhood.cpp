#include "merging/neighbourhood.h"

#include "range_image/simd.h"

namespace gantry::internal {

GANTRY_MULTIVERSION void Neighbourhood::gather(CellGrid& grid, const Block& block) {
  const Eigen::Vector3i middle = block_of_key(block.key);
  std::array<const Block*, 27> blocks;
  std::array<Shard*, 27> shards;
  for (int k = 0; k < 27; ++k) {
    const Eigen::Vector3i b = middle + step(k);
    const uint64_t key = block_key(b.x(), b.y(), b.z());
    shards[k] = &grid[shard_of_block(key)];
    blocks[k] = k == 13 ? &block : shards[k]->find(key);
  }
  cells_.clear();
  int i = 0;
  for (int x = -1; x <= kBlockEdge; ++x)
    for (int y = -1; y <= kBlockEdge; ++y)
      for (int z = -1; z <= kBlockEdge; ++z, ++i) {
        begins_[i] = static_cast<uint32_t>(cells_.size());
        const int k = ((x >> 2) + 1) * 9 + ((y >> 2) + 1) * 3 + (z >> 2) + 1;
        if (!blocks[k]) continue;
        const Eigen::Vector3f middle_of_voxel(x + 0.5f, y + 0.5f, z + 0.5f);
        const uint64_t shard_id = static_cast<uint64_t>(shards[k] - grid.data()) << 32;
        uint32_t link = blocks[k]->first[static_cast<size_t>((x & 3) << 4 | (y & 3) << 2 | (z & 3))];
        for (int place = 0; link != 0; ++place) {
          Cell& cell = shards[k]->cells[link - 1];
          const Eigen::Vector3f normal = cell.normal.value();
          cells_.push_back({middle_of_voxel + cell.offset.value(), normal * (1 / normal.norm()), &cell,
                            cell.count, cell.scans, i, place, shard_id | link});
          link = cell.next;
        }
      }
  begins_.back() = static_cast<uint32_t>(cells_.size());
}

}  // namespace gantry::internal
