#include "gantry/geometry/spatial_order.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "gantry/foundation/error.h"
#include "large_pages.h"

namespace gantry {
namespace {

constexpr int kBitsPerAxis = 10, kUpperBits = 12, kLowerBits = 3 * kBitsPerAxis - kUpperBits, kDigitBits = 9;
constexpr size_t kBlocks = size_t{1} << kUpperBits, kShare = 1 << 17;
constexpr size_t kRun = 1024, kSample = 2000;

struct Entry {
  uint32_t code, index;
};

/// Moves the lowest ten bits apart, two zeros between any two.
uint32_t spread(uint32_t x) {
  x = (x | x << 16) & 0x030000ff;
  x = (x | x << 8) & 0x0300f00f;
  x = (x | x << 4) & 0x030c30c3;
  return (x | x << 2) & 0x09249249;
}

/// A cube that holds nearly all points, judged by a sample: a few that lie far out would make its cells
/// large.
Eigen::AlignedBox3d cube_of_most(std::span<const Eigen::Vector3f> points) {
  std::array<std::vector<double>, 3> coordinates;
  for (size_t i = 0; i < points.size(); i += std::max<size_t>(1, points.size() / kSample)) {
    if (!points[i].allFinite()) continue;
    for (Eigen::Index axis = 0; axis < 3; ++axis)
      coordinates[static_cast<size_t>(axis)].push_back(points[i][axis]);
  }
  if (coordinates[0].empty()) return {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  Eigen::Vector3d centre, half;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    std::vector<double>& values = coordinates[static_cast<size_t>(axis)];
    std::sort(values.begin(), values.end());
    const double low = values[values.size() / 50], high = values[values.size() - 1 - values.size() / 50];
    centre[axis] = (low + high) / 2;
    half[axis] = 0.75 * (high - low);
  }
  const Eigen::Vector3d sizes = Eigen::Vector3d::Constant(half.maxCoeff());
  return {centre - sizes, centre + sizes};
}

/// By digits, the least significant first: each pass keeps the order of the one before.
void sort_by_lower_bits(std::span<Entry> entries) {
  static_assert(kLowerBits == 2 * kDigitBits, "two passes, the second of them back to where it began");
  if (entries.size() < 2) return;
  thread_local std::vector<Entry> others;
  others.resize(std::max(others.size(), entries.size()));
  std::span<Entry> from = entries, to = std::span(others).first(entries.size());
  for (int shift = 0; shift < kLowerBits; shift += kDigitBits, std::swap(from, to)) {
    const auto digit_of = [shift](const Entry& e) { return (e.code >> shift) & ((1u << kDigitBits) - 1); };
    std::array<uint32_t, 1 << kDigitBits> place{};
    for (const Entry& e : from) ++place[digit_of(e)];
    uint32_t before = 0;
    for (uint32_t& p : place) before += std::exchange(p, before);
    for (const Entry& e : from) to[place[digit_of(e)]++] = e;
  }
}

void order_along_curve(std::span<const Eigen::Vector3f> points, std::span<uint32_t> order) {
  if (points.size() > std::numeric_limits<uint32_t>::max())
    throw InputError("more than 4 thousand million points cannot be put in order");
  const Eigen::AlignedBox3d cube = cube_of_most(points);
  constexpr double kLast = (1 << kBitsPerAxis) - 1;
  const double size = cube.sizes().x(), cells = size > 0 ? (kLast + 1) / size : 0;
  const auto code_of = [&](const Eigen::Vector3f& point) {
    uint32_t code = 0;
    if (!point.allFinite()) return code;
    const Eigen::Array3d at = ((point.cast<double>() - cube.min()) * cells).array().max(0.0).min(kLast);
    for (int axis = 0; axis < 3; ++axis) code |= spread(static_cast<uint32_t>(at[axis])) << axis;
    return code;
  };

  // First into blocks of space by the upper bits, each share of the points to its own places in them; then
  // every block by itself, where the cache holds it. Until then `order` holds the codes.
  const size_t shares = (points.size() + kShare - 1) / kShare;
  std::vector<std::array<uint32_t, kBlocks>> place(shares);
  const auto for_each_share = [&](auto&& work) {
    tbb::parallel_for(size_t{0}, shares, [&](size_t share) {
      work(place[share], share * kShare, std::min((share + 1) * kShare, points.size()));
    });
  };
  for_each_share([&](auto& count, size_t first, size_t end) {
    count.fill(0);
    for (size_t i = first; i < end; ++i) {
      order[i] = code_of(points[i]);
      ++count[order[i] >> kLowerBits];
    }
  });
  std::array<uint32_t, kBlocks + 1> block{};
  uint32_t before = 0;
  for (size_t b = 0; b < kBlocks; ++b) {
    block[b] = before;
    for (auto& of_share : place) before += std::exchange(of_share[b], before);
  }
  block[kBlocks] = before;
  internal::LargeVector<Entry> entries(points.size());
  for_each_share([&](auto& next, size_t first, size_t end) {
    for (size_t i = first; i < end; ++i)
      entries[next[order[i] >> kLowerBits]++] = {order[i], static_cast<uint32_t>(i)};
  });
  tbb::parallel_for(size_t{0}, kBlocks, [&](size_t b) {
    const auto in_block = std::span(entries).subspan(block[b], block[b + 1] - block[b]);
    sort_by_lower_bits(in_block);
    for (size_t k = 0; k < in_block.size(); ++k) order[block[b] + k] = in_block[k].index;
  });
}

}  // namespace

std::vector<uint32_t> morton_order(std::span<const Eigen::Vector3f> points) {
  std::vector<uint32_t> order(points.size());
  order_along_curve(points, order);
  return order;
}

void for_each_run(std::span<const Eigen::Vector3f> points,
                  const std::function<void(std::span<const uint32_t>)>& visit) {
  internal::LargeVector<uint32_t> order(points.size());
  order_along_curve(points, order);
  const size_t runs = (order.size() + kRun - 1) / kRun;
  tbb::parallel_for(size_t{0}, runs, [&](size_t r) {
    const auto run =
        std::span<const uint32_t>(order).subspan(r * kRun, std::min(kRun, order.size() - r * kRun));
    // They lie apart in memory: asked for one by one, each would be waited for.
    for (const uint32_t i : run) __builtin_prefetch(&points[i]);
    visit(run);
  });
}

}  // namespace gantry
