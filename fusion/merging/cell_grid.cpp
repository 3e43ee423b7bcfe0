#include "merging/cell_grid.h"

#include "range_image/simd.h"

namespace gantry::internal {

size_t Shard::slot_of(uint64_t key) const {
  const size_t mask = table_.size() - 1;
  size_t slot = static_cast<size_t>(key * 0xD6E8FEB86659FD93u >> 32) & mask;
  while (table_[slot] != 0 && blocks[table_[slot] - 1].key != key) slot = (slot + 1) & mask;
  return slot;
}

const Block* Shard::find(uint64_t key) const {
  if (table_.empty()) return nullptr;
  const uint32_t found = table_[slot_of(key)];
  return found == 0 ? nullptr : &blocks[found - 1];
}

void Shard::enlarge_table() {
  table_.assign(table_.empty() ? 256 : 2 * table_.size(), 0);
  for (size_t b = 0; b < blocks.size(); ++b) table_[slot_of(blocks[b].key)] = static_cast<uint32_t>(b + 1);
}

Block& Shard::block(uint64_t key) {
  if (2 * (blocks.size() + 1) > table_.size()) enlarge_table();
  const size_t slot = slot_of(key);
  if (table_[slot] == 0) {
    blocks.grow().key = key;
    table_[slot] = static_cast<uint32_t>(blocks.size());
  }
  return blocks[table_[slot] - 1];
}

/// Running means lose nothing to the size of the sums, however many measurements there are.
[[gnu::always_inline]] inline void Shard::accumulate(Cell& cell, const Measurement& m, uint16_t scan) {
  if (cell.count == 0 || cell.tag != scan) {
    cell.tag = scan;
    cell.scans = static_cast<uint8_t>(cell.scans + (cell.scans < 255));
    contributions.grow() = {0, cell.latest, scan};
    cell.latest = static_cast<uint32_t>(contributions.size());
  }
  contributions[cell.latest - 1].weight += m.weight;
  cell.weight += m.weight;
  ++cell.count;
  const float share = m.weight / cell.weight;
  const Eigen::Vector3f offset = cell.offset.value(), normal = cell.normal.value();
  cell.offset = to_fixed(offset + share * (m.offset.value() - offset));
  cell.normal = to_fixed(normal + share * (m.normal.value() - normal));
}

void Shard::take_contributions(Cell& cell, const Shard& its, const Cell& other) {
  its.for_contributions(other, [&](const Contribution& given) {
    uint32_t link = cell.latest;
    while (link != 0 && contributions[link - 1].scan != given.scan) link = contributions[link - 1].next;
    if (link != 0) {
      contributions[link - 1].weight += given.weight;
      return;
    }
    const Contribution copy{given.weight, cell.latest, given.scan};
    contributions.grow() = copy;
    cell.latest = static_cast<uint32_t>(contributions.size());
  });
}

GANTRY_MULTIVERSION void Shard::add(const Measurement* all, std::span<const uint32_t> which, uint16_t scan) {
  Block* here = nullptr;
  for (const uint32_t i : which) {
    const Measurement& m = all[i];
    const Eigen::Vector3f normal = m.normal.value();
    const uint64_t key = m.cell >> 6;
    if (!here || here->key != key) here = &block(key);  // pixels side by side share it
    uint32_t* link = &here->first[m.cell & 63];
    Cell *chosen = nullptr, *nearest = nullptr;
    float nearest_cosine2 = 0;
    int cells_here = 0;
    for (; *link != 0 && !chosen; ++cells_here) {
      Cell& cell = cells[*link - 1];
      const Eigen::Vector3f mean = cell.normal.value();
      const float along = mean.dot(normal);
      const float cosine2 = along > 0 ? along * along / mean.squaredNorm() : 0;
      if (cosine2 > kSameSurfaceCosine * kSameSurfaceCosine) chosen = &cell;
      if (cosine2 > nearest_cosine2) {
        nearest = &cell;
        nearest_cosine2 = cosine2;
      }
      link = &cell.next;
    }
    if (!chosen && cells_here < kMaxCellsOfVoxel) {
      chosen = &cells.grow();
      *link = static_cast<uint32_t>(cells.size());
    }
    if (!chosen) chosen = nearest;
    if (chosen) accumulate(*chosen, m, scan);
  }
}

void Shard::release() {
  blocks.release();
  cells.release();
  contributions.release();
  table_ = {};
}

}  // namespace gantry::internal
