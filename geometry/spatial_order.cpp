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

constexpr int kBitsPerAxis = 10, kDigitBits = 10, kDigits = 3 * kBitsPerAxis / kDigitBits;
constexpr size_t kRun = 1024, kSample = 2000;

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

}  // namespace

std::vector<uint32_t> morton_order(std::span<const Eigen::Vector3f> points) {
  if (points.size() > std::numeric_limits<uint32_t>::max())
    throw InputError("more than 4 thousand million points cannot be put in order");
  const Eigen::AlignedBox3d cube = cube_of_most(points);
  constexpr double kLast = (1 << kBitsPerAxis) - 1;
  const double size = cube.sizes().x(), cells = size > 0 ? (kLast + 1) / size : 0;

  struct Entry {
    uint32_t code, index;
  };
  std::vector<Entry> entries(points.size()), sorted(points.size());
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t i) {
    uint32_t code = 0;
    if (points[i].allFinite()) {
      const Eigen::Array3d at = ((points[i].cast<double>() - cube.min()) * cells).array().max(0.0).min(kLast);
      for (int axis = 0; axis < 3; ++axis) code |= spread(static_cast<uint32_t>(at[axis])) << axis;
    }
    entries[i] = {code, static_cast<uint32_t>(i)};
  });
  // By digits, the least significant first: each pass keeps the order of the one before.
  for (int digit = 0; digit < kDigits; ++digit) {
    const auto digit_of = [digit](const Entry& e) {
      return (e.code >> (digit * kDigitBits)) & ((1u << kDigitBits) - 1);
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
