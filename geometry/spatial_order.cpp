#include "gantry/geometry/spatial_order.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr int kBitsPerAxis = 16, kDigitBits = 12, kDigits = 3 * kBitsPerAxis / kDigitBits;
constexpr size_t kRun = 1024;

/// Moves the lowest 21 bits apart, two zeros between any two.
uint64_t spread(uint64_t x) {
  x = (x | x << 32) & 0x001f00000000ffff;
  x = (x | x << 16) & 0x001f0000ff0000ff;
  x = (x | x << 8) & 0x100f00f00f00f00f;
  x = (x | x << 4) & 0x10c30c30c30c30c3;
  return (x | x << 2) & 0x1249249249249249;
}

}  // namespace

std::vector<uint32_t> morton_order(std::span<const Eigen::Vector3f> points) {
  if (points.size() > std::numeric_limits<uint32_t>::max())
    throw InputError("more than 4 thousand million points cannot be put in order");
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& p : points)
    if (p.allFinite()) box.extend(p.cast<double>());
  const double longest = box.isEmpty() ? 0 : box.sizes().maxCoeff();
  const double cells = longest > 0 ? ((1 << kBitsPerAxis) - 1) / longest : 0;

  struct Entry {
    uint64_t code;
    uint32_t index;
  };
  std::vector<Entry> entries(points.size()), sorted(points.size());
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t i) {
    uint64_t code = 0;
    if (points[i].allFinite()) {
      const Eigen::Vector3d at = (points[i].cast<double>() - box.min()) * cells;
      for (int axis = 0; axis < 3; ++axis) code |= spread(static_cast<uint64_t>(at[axis])) << axis;
    }
    entries[i] = {code, static_cast<uint32_t>(i)};
  });
  // By digits, the least significant first: each pass keeps the order of the one before.
  for (int digit = 0; digit < kDigits; ++digit) {
    const auto digit_of = [digit](const Entry& e) {
      return (e.code >> (digit * kDigitBits)) & ((uint64_t{1} << kDigitBits) - 1);
    };
    std::array<size_t, 1 << kDigitBits> place{};
    for (const Entry& e : entries) ++place[digit_of(e)];
    size_t before = 0;
    for (size_t& p : place) before += std::exchange(p, before);
    for (const Entry& e : entries) sorted[place[digit_of(e)]++] = e;
    entries.swap(sorted);
  }
  std::vector<uint32_t> order(points.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = entries[i].index;
  return order;
}

void for_each_run(std::span<const Eigen::Vector3f> points,
                  const std::function<void(std::span<const uint32_t>)>& visit) {
  const std::vector<uint32_t> order = morton_order(points);
  const size_t runs = (order.size() + kRun - 1) / kRun;
  tbb::parallel_for(size_t{0}, runs, [&](size_t run) {
    visit(std::span(order).subspan(run * kRun, std::min(kRun, order.size() - run * kRun)));
  });
}

}  // namespace gantry
