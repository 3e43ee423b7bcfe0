#include "merging/scan_measurements.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "gantry/foundation/error.h"
#include "range_image/simd.h"

namespace gantry::internal {
namespace {

constexpr int kStripRows = 16;

/// The rays of one row: a polynomial in the column alone.
struct RowRays {
  Eigen::Vector2d c0, c1, c2, c3;
  RowRays(const RayModel& rays, double row) {
    const RayModel::Polynomial& p = rays.ray_of_pixel;
    c0 = p.col(0) + row * (p.col(2) + row * (p.col(5) + row * p.col(9)));
    c1 = p.col(1) + row * (p.col(4) + row * p.col(8));
    c2 = p.col(3) + row * p.col(7);
    c3 = p.col(6);
  }
  Eigen::Vector2d operator()(double column) const { return c0 + column * (c1 + column * (c2 + column * c3)); }
};

/// Turns pixels of one scan into measurements.
struct Unpacker {
  const RangeSurface& surface;
  Pose part_from_grid;
  Eigen::Matrix3f rotation;
  double cells_per_mm;

  Unpacker(const RangeSurface& s, const Pose& part_from_sensor, double cell_mm)
      : surface(s),
        part_from_grid(part_from_sensor * s.sensor_from_grid),
        rotation(part_from_grid.linear().cast<float>()),
        cells_per_mm(1 / cell_mm) {}

  /// False: outside the range of cells, or not a number.
  [[gnu::always_inline]] inline bool unpack(const Eigen::Vector2d& ray, size_t pixel, Measurement& m) const {
    const Eigen::Vector3d p = surface.rays.point(ray, surface.w[pixel]);
    const Eigen::Vector3d scaled = cells_per_mm * (part_from_grid * p);
    if (!(scaled.cwiseAbs().maxCoeff() < kCellRange - kBlockEdge)) return false;
    CellIndex cell;
    for (int k = 0; k < 3; ++k) {
      cell[k] = static_cast<int>(scaled[k]);
      cell[k] -= scaled[k] < cell[k];
    }
    m.cell = cell_key(cell);
    m.offset = to_fixed((scaled - cell.cast<double>()).cast<float>() - Eigen::Vector3f::Constant(0.5f));
    m.normal = to_fixed(rotation * unpack_normal(surface.normals[pixel]));
    const double sigma = std::max(surface.sigma_mm(p), 1e-6);
    m.weight = static_cast<float>(1 / (sigma * sigma));
    return true;
  }
};

/// Appends the usable pixels of a row; false: one is out of range.
GANTRY_MULTIVERSION bool unpack_row(const Unpacker& unpacker, int row, Measurement* measurements,
                                    uint32_t& count) {
  const RangeSurface& s = unpacker.surface;
  const RowRays rays(s.rays, row);
  for (int column = 0; column < s.width; ++column) {
    const size_t pixel = s.index(column, row);
    if (s.w[pixel] == 0) continue;
    if (!unpacker.unpack(rays(column), pixel, measurements[count])) return false;
    ++count;
  }
  return true;
}

}  // namespace

void ScanMeasurements::unpack(const RangeSurface& s, const Pose& part_from_sensor, double cell_mm) {
  if (s.w.size() > capacity_) {
    capacity_ = s.w.size();
    measurements_ = std::make_unique_for_overwrite<Measurement[]>(capacity_);
    order_ = std::make_unique_for_overwrite<uint32_t[]>(capacity_);
  }
  const Unpacker unpacker(s, part_from_sensor, cell_mm);
  strips_.assign(static_cast<size_t>((s.height + kStripRows - 1) / kStripRows), {});
  tbb::parallel_for(size_t{0}, strips_.size(), [&](size_t k) {
    Strip& strip = strips_[k];
    const int first_row = static_cast<int>(k) * kStripRows;
    strip.first = s.index(0, first_row);
    Measurement* const measurements = &measurements_[strip.first];
    uint32_t count = 0;
    for (int row = first_row; row < std::min(s.height, first_row + kStripRows); ++row)
      strip.in_range = unpack_row(unpacker, row, measurements, count) && strip.in_range;
    for (uint32_t i = 0; i < count; ++i) ++strip.begins[shard_of_block(measurements[i].cell >> 6) + 1];
    for (size_t shard = 0; shard < kShards; ++shard) strip.begins[shard + 1] += strip.begins[shard];
    std::array<uint32_t, kShards + 1> next = strip.begins;
    for (uint32_t i = 0; i < count; ++i)
      order_[strip.first + next[shard_of_block(measurements[i].cell >> 6)]++] = i;
  });
  size_ = 0;
  for (const Strip& strip : strips_) {
    if (!strip.in_range)
      throw InputError("merge: scan " + s.name + " has points that are no numbers or lie more than " +
                       std::to_string(kCellRange * cell_mm) +
                       " mm from the origin of the part frame, a million cells of voxel_mm = " +
                       std::to_string(cell_mm) + "; check its pose, or choose larger cells");
    size_ += strip.begins.back();
  }
}

}  // namespace gantry::internal
