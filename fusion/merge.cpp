#include "gantry/fusion/merge.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"
#include "merging/cell_fates.h"
#include "merging/cell_grid.h"
#include "merging/scan_measurements.h"

namespace gantry {
namespace {

using internal::Block;
using internal::Cell;
using internal::CellGrid;
using internal::kShards;
using internal::Shard;

constexpr double kCellsPerSpacing = 1.1;  ///< Coarser cells would shave the crest off a burr.

void check(const MergeOptions& options) {
  if (!(options.voxel_mm >= 0) || !std::isfinite(options.voxel_mm))
    throw InputError("merge: voxel_mm is " + std::to_string(options.voxel_mm) +
                     "; expected a length in mm, or 0 to choose it from the scans");
  if (!(options.correlated_share >= 0 && options.correlated_share <= 1))
    throw InputError("merge: correlated_share is " + std::to_string(options.correlated_share) +
                     "; expected a fraction from 0 to 1");
}

double cell_for(const MergeOptions& options, double spacing_mm) {
  if (options.voxel_mm > 0) return options.voxel_mm;
  if (!(spacing_mm > 0) || !std::isfinite(spacing_mm))
    throw InputError("merge: the scans' point spacing is not known (spacing_mm = " +
                     std::to_string(spacing_mm) + "); give voxel_mm");
  return kCellsPerSpacing * spacing_mm;
}

/// How many cells of a shard met each fate, and how many contributions its points have.
struct Counts {
  std::array<size_t, internal::kThinned + 1> fates{};
  size_t contributions = 0;
};

Counts count(const Shard& shard) {
  Counts counts;
  for (size_t c = 0; c < shard.cells.size(); ++c) {
    ++counts.fates[shard.cells[c].tag];
    if (shard.cells[c].tag != internal::kPoint) continue;
    shard.for_contributions(shard.cells[c], [&](const internal::Contribution&) { ++counts.contributions; });
  }
  return counts;
}

/// Writes the shares of a cell's scans from `out` on, in the order of the scans.
size_t write_shares(const Shard& shard, const Cell& cell, size_t out, CloudSources& sources) {
  const auto begin = sources.shares.begin() + static_cast<std::ptrdiff_t>(out);
  double sum = 0;
  shard.for_contributions(cell, [&](const internal::Contribution& c) { sum += c.weight; });
  shard.for_contributions(cell, [&](const internal::Contribution& c) {
    const double parts = std::round(CloudSources::Share::kWhole * (c.weight / sum));
    sources.shares[out++] = {c.scan, static_cast<uint16_t>(parts)};
  });
  std::sort(begin, sources.shares.begin() + static_cast<std::ptrdiff_t>(out),
            [](const auto& a, const auto& b) { return a.scan < b.scan; });
  return out;
}

/// Writes the points of a shard from `out` on, and their shares from `share` on.
void write_points(const Shard& shard, double cell_mm, double correlated_share, size_t out, size_t share,
                  PointCloud& cloud, CloudSources& sources) {
  for (size_t b = 0; b < shard.blocks.size(); ++b) {
    const Block& block = shard.blocks[b];
    const Eigen::Vector3d corner = (internal::kBlockEdge * internal::block_of_key(block.key)).cast<double>();
    for (int v = 0; v < 64; ++v) {
      const Eigen::Vector3d middle =
          corner + Eigen::Vector3d((v >> 4) + 0.5, (v >> 2 & 3) + 0.5, (v & 3) + 0.5);
      for (uint32_t link = block.first[static_cast<size_t>(v)]; link != 0;) {
        const Cell& cell = shard.cells[link - 1];
        link = cell.next;
        if (cell.tag != internal::kPoint) continue;
        cloud.points[out] = (cell_mm * (middle + cell.offset.value().cast<double>())).cast<float>();
        cloud.normals[out] = cell.normal.value().normalized();
        const double variance = std::max(1.0, correlated_share * cell.count) / cell.weight;
        cloud.sigma_mm[out] = static_cast<float>(std::sqrt(variance));
        sources.first[out++] = static_cast<uint32_t>(share);
        share = write_shares(shard, cell, share, sources);
      }
    }
  }
}

}  // namespace

struct CloudMerger::Impl {
  MergeOptions options;
  double cell_mm = 0;  ///< 0: nothing was added yet.
  size_t measurements = 0;
  std::vector<std::string> scans;  ///< Names.
  CellGrid grid;
  internal::ScanMeasurements scan;
};

CloudMerger::CloudMerger(const MergeOptions& options) : impl_(std::make_unique<Impl>()) {
  check(options);
  impl_->options = options;
}

CloudMerger::~CloudMerger() = default;

void CloudMerger::add(const RangeSurface& surface, const Pose& part_from_sensor) {
  Impl& impl = *impl_;
  const double cell_mm = impl.cell_mm > 0 ? impl.cell_mm : cell_for(impl.options, surface.spacing_mm);
  impl.scan.unpack(surface, part_from_sensor, cell_mm);
  impl.cell_mm = cell_mm;
  const auto number = static_cast<uint16_t>(impl.scans.size());
  impl.scans.push_back(surface.name);
  impl.measurements += impl.scan.size();
  tbb::parallel_for(size_t{0}, kShards, [&](size_t s) { impl.scan.add_to(impl.grid[s], s, number); });
}

PointCloud CloudMerger::finish(MergeReport* report) {
  Impl& impl = *impl_;
  MergeReport summary;
  summary.voxel_mm = impl.cell_mm;
  summary.measurements = impl.measurements;
  summary.memory_bytes = impl.scan.bytes();
  for (const Shard& shard : impl.grid) {
    summary.memory_bytes += shard.bytes();
    summary.cells += shard.cells.size();
  }
  impl.scan = {};
  internal::decide_fates(impl.grid, impl.cell_mm, impl.options.min_support);
  if (impl.options.uniform_density) internal::thin_evenly(impl.grid);

  std::array<Counts, kShards> counts;
  tbb::parallel_for(size_t{0}, kShards, [&](size_t s) { counts[s] = count(impl.grid[s]); });
  std::array<size_t, kShards> begins, share_begins;
  size_t shares = 0;
  for (size_t s = 0; s < kShards; ++s) {
    const auto& fates = counts[s].fates;
    begins[s] = summary.points;
    share_begins[s] = shares;
    summary.points += fates[internal::kPoint];
    summary.unsupported += fates[internal::kUnsupported];
    summary.contradicted += fates[internal::kContradicted];
    summary.duplicates += fates[internal::kAbsorbed];
    summary.thinned += fates[internal::kThinned];
    shares += counts[s].contributions;
  }
  const auto sources = std::make_shared<CloudSources>();
  sources->scans = std::move(impl.scans);
  sources->first.resize(summary.points + 1, static_cast<uint32_t>(shares));
  sources->shares.resize(shares);
  PointCloud cloud;
  cloud.points.resize(summary.points);
  cloud.normals.resize(summary.points);
  cloud.sigma_mm.resize(summary.points);
  // Cells go as points come, so that both are never held in full.
  tbb::parallel_for(size_t{0}, kShards, [&](size_t s) {
    write_points(impl.grid[s], impl.cell_mm, impl.options.correlated_share, begins[s], share_begins[s], cloud,
                 *sources);
    impl.grid[s].release();
  });
  impl.cell_mm = 0;
  impl.scans.clear();
  impl.measurements = 0;
  cloud.sources = sources;
  if (report) *report = summary;
  return cloud;
}

PointCloud merge_surfaces(std::span<const RangeSurface> surfaces, std::span<const Pose> part_from_sensor,
                          const MergeOptions& options, MergeReport* report) {
  if (surfaces.size() != part_from_sensor.size())
    throw InputError("merge: " + std::to_string(surfaces.size()) + " scans but " +
                     std::to_string(part_from_sensor.size()) + " poses; expected one for each");
  check(options);
  MergeOptions chosen = options;
  if (!surfaces.empty()) {
    std::vector<double> spacings;
    for (const auto& s : surfaces) spacings.push_back(s.spacing_mm);
    const auto middle = spacings.begin() + static_cast<std::ptrdiff_t>(spacings.size() / 2);
    std::nth_element(spacings.begin(), middle, spacings.end());
    chosen.voxel_mm = cell_for(options, *middle);
  }
  CloudMerger merger(chosen);
  for (size_t s = 0; s < surfaces.size(); ++s) merger.add(surfaces[s], part_from_sensor[s]);
  return merger.finish(report);
}

}  // namespace gantry
