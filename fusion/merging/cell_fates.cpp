#include "merging/cell_fates.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <utility>

#include "merging/neighbourhood.h"
#include "range_image/simd.h"

namespace gantry::internal {
namespace {

// Lengths in units of the cell's edge.
constexpr float kDuplicate = 0.5f;
constexpr uint32_t kMuchMore = 4;      ///< Times the measurements of the other.
constexpr float kThrownBySigmas = 3;   ///< Off the surface, of a single measurement.
constexpr float kAlongSurface = 0.6f;  ///< What a distance along the surface then counts.
constexpr float kEvenSpacing = 0.7f;
constexpr float kOffSurface = 0.5f;       ///< Nearer to the surface, a lone measurement does no harm.
constexpr float kOffSurfaceInSigmas = 4;  ///< What noise explains is no contradiction.
constexpr float kAgreeingCosine = 0.5f;   ///< Surfaces that can contradict a measurement, 60 degrees.
constexpr float kBeside = 1.2f;           ///< How far along the surface they may lie from it.
constexpr size_t kAgreeing = 3;           ///< How many cells must tell.
/// A tag while duplicates are sought: of a pair the other one is the point.
constexpr uint16_t kYields = 101;
constexpr int kPlaces = kMaxCellsOfVoxel;

/// Calls `use(block, neighbourhood)` for every block in which `wanted(block, shard)`.
template <class Wanted, class Use>
void for_blocks(CellGrid& grid, const Wanted& wanted, const Use& use) {
  tbb::parallel_for(size_t{0}, kShards, [&](size_t s) {
    Neighbourhood near;
    for (size_t b = 0; b < grid[s].blocks.size(); ++b) {
      const Block& block = grid[s].blocks[b];
      if (!wanted(grid[s], block)) continue;
      near.gather(grid, block);
      use(near);
    }
  });
}

template <class Wanted>
bool any_cell(Shard& shard, const Block& block, const Wanted& wanted) {
  for (uint32_t link : block.first)
    for (; link != 0; link = shard.cells[link - 1].next)
      if (wanted(shard.cells[link - 1])) return true;
  return false;
}

/// Whether several scans agree on a surface that the cell is off, while hardly anything agrees with it.
[[gnu::always_inline]] inline bool contradicted(const Neighbourhood& near, const NearCell& own, float sigma,
                                                size_t min_support) {
  const float tolerance = std::max(kOffSurface, kOffSurfaceInSigmas * sigma);
  std::array<float, 27 * kPlaces> off;
  size_t agreeing = 0, with_own = 0;
  near.for_near(own, [&](const NearCell& other) {
    const Eigen::Vector3f between = own.position - other.position;
    const float cosine = own.normal.dot(other.normal);
    if (cosine > kSameSurfaceCosine && std::abs(own.normal.dot(between)) < 0.5f * kOffSurface)
      with_own += other.count;
    if (other.scans < 2 || cosine < kAgreeingCosine) return;
    const float along_normal = other.normal.dot(between);
    if (between.squaredNorm() - along_normal * along_normal > kBeside * kBeside) return;
    off[agreeing++] = along_normal;
  });
  if (agreeing < kAgreeing || with_own >= min_support) return false;
  // The median: one bad cell among those that agree does not decide.
  std::nth_element(off.begin(), off.begin() + agreeing / 2, off.begin() + agreeing);
  return std::abs(off[agreeing / 2]) > tolerance;
}

/// How far two cells of a surface are from being the same point, squared. What noise throws over the border
/// of a well measured cell leaves a few measurements there, off the surface by as much and anywhere along it:
/// for those the distance along the surface counts less.
float unlikeness(const NearCell& a, const NearCell& b, double cell_mm) {
  const Eigen::Vector3f between = a.position - b.position;
  const float distance = between.squaredNorm();
  const NearCell& few = a.count < b.count ? a : b;
  const NearCell& many = a.count < b.count ? b : a;
  if (few.count * kMuchMore > many.count) return distance;
  const float off = many.normal.dot(between);
  const auto variance = static_cast<float>(few.count / (few.cell->weight * cell_mm * cell_mm));
  if (off * off > kThrownBySigmas * kThrownBySigmas * variance) return distance;
  return off * off + kAlongSurface * kAlongSurface * (distance - off * off);
}

/// Fate (tag) of every cell, and as its mark the nearest cell that may be the same point: 1 + 8 k + place.
GANTRY_MULTIVERSION void judge(const Neighbourhood& near, double cell_mm, size_t min_support) {
  near.for_own([&](const NearCell& own) {
    size_t support = 0, agreeing = 0;
    float smallest = kDuplicate * kDuplicate;
    const NearCell* nearest = nullptr;
    near.for_near(own, [&](const NearCell& other) {
      const float cosine = own.normal.dot(other.normal);
      if (cosine <= 0) return;
      support += other.count;
      agreeing += other.scans > 1;
      if (cosine < kSameSurfaceCosine || other.cell == own.cell) return;
      const float distance = unlikeness(own, other, cell_mm);
      if (distance >= smallest) return;
      smallest = distance;
      nearest = &other;
    });
    own.cell->tag = kPoint;
    own.cell->mark = 0;
    if (nearest) {
      const int k = Neighbourhood::step_number(own, *nearest);
      own.cell->mark = static_cast<uint8_t>(1 + kPlaces * k + nearest->place);
      // The one with more measurements stays; of equals the one that is the later in space.
      const std::pair mine(own.count, std::pair(13, own.place)),
          theirs(nearest->count, std::pair(k, nearest->place));
      if (mine < theirs) own.cell->tag = kYields;
    }
    if (support < min_support) {
      own.cell->tag = kUnsupported;
    } else if (own.scans == 1 && own.count < min_support && agreeing >= kAgreeing) {
      const double sigma = 1 / std::sqrt(own.cell->weight / static_cast<float>(own.count)) / cell_mm;
      if (contradicted(near, own, static_cast<float>(sigma), min_support)) own.cell->tag = kContradicted;
    }
    if (own.cell->tag == kUnsupported || own.cell->tag == kContradicted) own.cell->mark = 0;
  });
}

/// The shard in which a cell lies.
Shard& shard_of(CellGrid& grid, const CellIndex& index) {
  return grid[shard_of_block(cell_key(index) >> 6)];
}

Cell* find_cell(CellGrid& grid, const CellIndex& index, int place) {
  const uint64_t key = cell_key(index);
  Shard& shard = shard_of(grid, index);
  const Block* block = shard.find(key >> 6);
  uint32_t link = block ? block->first[key & 63] : 0;
  for (; link != 0 && place > 0; --place) link = shard.cells[link - 1].next;
  return link == 0 ? nullptr : &shard.cells[link - 1];
}

/// Of two that chose each other one takes the other in. Only the taker's sums and the own tag change, and
/// neither is read by anybody else meanwhile.
void absorb(CellGrid& grid, const CellIndex& index, int place, Cell& cell) {
  if (cell.mark == 0) return;
  const bool yields = cell.tag == kYields;
  cell.tag = kPoint;
  const int k = (cell.mark - 1) / kPlaces, other_place = (cell.mark - 1) % kPlaces;
  const Eigen::Vector3i step = Neighbourhood::step(k);
  const Cell* other = find_cell(grid, index + step, other_place);
  if (!other || other->mark != 1 + kPlaces * (26 - k) + place) return;
  if (yields) {
    cell.tag = kAbsorbed;
    return;
  }
  const float share = other->weight / (cell.weight + other->weight);
  const Eigen::Vector3f offset = cell.offset.value(), normal = cell.normal.value();
  const Eigen::Vector3f merged = offset + share * (step.cast<float>() + other->offset.value() - offset);
  cell.offset = to_fixed(merged.cwiseMax(-1.0f).cwiseMin(1.0f));
  cell.normal = to_fixed(normal + share * (other->normal.value() - normal));
  cell.weight += other->weight;
  cell.count += other->count;
  shard_of(grid, index).take_contributions(cell, shard_of(grid, index + step), *other);
}

/// A random order without ties: both steps can be undone, so different cells differ.
uint64_t priority(const NearCell& cell) {
  uint64_t x = (cell.id ^ cell.id >> 31) * 0xBF58476D1CE4E5B9u;
  return (x ^ x >> 29) * 0x94D049BB133111EBu;
}

bool rivals(const NearCell& a, const NearCell& b) {
  return a.cell != b.cell && a.normal.dot(b.normal) > kSameSurfaceCosine &&
         (a.position - b.position).squaredNorm() < kEvenSpacing * kEvenSpacing;
}

// While thinning, marks say what is settled and this tag who is chosen in the present round.
constexpr uint8_t kOpen = 1, kIn = 2, kOut = 3;
constexpr uint16_t kChosen = 100;

}  // namespace

void decide_fates(CellGrid& grid, double cell_mm, size_t min_support) {
  for_blocks(
      grid, [](Shard&, const Block&) { return true; },
      [&](const Neighbourhood& near) { judge(near, cell_mm, min_support); });
  tbb::parallel_for(size_t{0}, kShards, [&](size_t s) {
    for (size_t b = 0; b < grid[s].blocks.size(); ++b) {
      const Block& block = grid[s].blocks[b];
      const Eigen::Vector3i corner = kBlockEdge * block_of_key(block.key);
      for (int v = 0; v < 64; ++v) {
        uint32_t link = block.first[static_cast<size_t>(v)];
        for (int place = 0; link != 0; ++place, link = grid[s].cells[link - 1].next)
          absorb(grid, corner + Eigen::Vector3i(v >> 4, v >> 2 & 3, v & 3), place, grid[s].cells[link - 1]);
      }
    }
  });
}

void thin_evenly(CellGrid& grid) {
  const auto for_cells = [&](const auto& use) {
    tbb::parallel_for(size_t{0}, kShards, [&](size_t s) {
      for (size_t c = 0; c < grid[s].cells.size(); ++c) use(grid[s].cells[c]);
    });
  };
  const auto open = [](Shard& shard, const Block& block) {
    return any_cell(shard, block, [](const Cell& cell) { return cell.mark == kOpen; });
  };
  for_cells([](Cell& cell) { cell.mark = cell.tag == kPoint ? kOpen : kOut; });
  for (std::atomic<bool> any_open = true; any_open;) {
    // Marks are read and tags written, then the other way round.
    for_blocks(grid, open, [&](const Neighbourhood& near) {
      near.for_own([&](const NearCell& own) {
        if (own.cell->mark != kOpen) return;
        bool first = true;
        near.for_near(own, [&](const NearCell& other) {
          if (other.cell->mark == kOpen && rivals(own, other) && priority(other) < priority(own))
            first = false;
        });
        own.cell->tag = first ? kChosen : uint16_t{kPoint};
      });
    });
    any_open = false;
    for_blocks(grid, open, [&](const Neighbourhood& near) {
      near.for_own([&](const NearCell& own) {
        if (own.cell->mark != kOpen) return;
        if (own.cell->tag == kChosen) {
          own.cell->mark = kIn;
          return;
        }
        near.for_near(own, [&](const NearCell& other) {
          if (other.cell->tag == kChosen && rivals(own, other)) own.cell->mark = kOut;
        });
        if (own.cell->mark == kOpen) any_open = true;
      });
    });
  }
  for_cells([](Cell& cell) {
    if (cell.tag == kPoint || cell.tag == kChosen) cell.tag = cell.mark == kIn ? kPoint : kThinned;
  });
}

}  // namespace gantry::internal
