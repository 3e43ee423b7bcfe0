#include "distances/earth_movers.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

#include "distances/assignment.h"

namespace gantry::internal {
namespace {

using Points = std::span<const Eigen::Vector3f>;
using Indices = std::span<uint32_t>;

/// A cloud condensed to groups of equally many points.
struct Groups {
  std::vector<uint32_t> order;         ///< Points by group; those after the last full group are left out.
  std::vector<Eigen::Vector3d> means;  ///< Of each group.
  std::vector<double> moved_mm;        ///< How far each point that takes part is from its mean.
};

/// Orders points so that every `size` in a row are a compact group. Equal coordinates go by index: the same
/// groups for the same points, whatever the standard library.
void cut(Points points, Indices part, size_t size) {
  const size_t groups = part.size() / size;
  if (groups < 2) return;
  Eigen::AlignedBox3f box;
  for (const uint32_t i : part) box.extend(points[i]);
  Eigen::Index axis = 0;
  box.sizes().maxCoeff(&axis);
  const size_t middle = (groups / 2) * size;
  std::nth_element(
      part.begin(), part.begin() + static_cast<std::ptrdiff_t>(middle), part.end(),
      [&](uint32_t i, uint32_t j) { return std::pair(points[i][axis], i) < std::pair(points[j][axis], j); });
  cut(points, part.first(middle), size);
  cut(points, part.subspan(middle), size);
}

Groups grouped(Points points, size_t size) {
  Groups groups;
  groups.order.resize(points.size());
  std::iota(groups.order.begin(), groups.order.end(), 0u);
  cut(points, groups.order, size);
  for (size_t begin = 0; begin + size <= points.size(); begin += size) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (size_t k = begin; k < begin + size; ++k) mean += points[groups.order[k]].cast<double>();
    mean /= static_cast<double>(size);
    for (size_t k = begin; k < begin + size; ++k)
      groups.moved_mm.push_back((points[groups.order[k]].cast<double>() - mean).norm());
    groups.means.push_back(mean);
  }
  return groups;
}

double sum_of_largest(std::vector<double> values, size_t count) {
  std::sort(values.begin(), values.end(), std::greater<>());
  return std::accumulate(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(count), 0.0);
}

}  // namespace

EarthMovers earth_movers(Points a, Points b, size_t exact_points) {
  const bool a_is_smaller = a.size() <= b.size();
  const Points small = a_is_smaller ? a : b, large = a_is_smaller ? b : a;
  const double pairs = static_cast<double>(small.size()) * static_cast<double>(large.size());
  const auto wanted = static_cast<size_t>(std::ceil(std::sqrt(pairs) / static_cast<double>(exact_points)));
  const size_t size = std::min(wanted, small.size());  // so that there is one group at least
  const Groups from = grouped(small, size), to = grouped(large, size);
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> cost(from.means.size(),
                                                                              to.means.size());
  for (size_t i = 0; i < from.means.size(); ++i)
    for (size_t j = 0; j < to.means.size(); ++j)
      cost(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = (from.means[i] - to.means[j]).norm();
  const std::vector<uint32_t> partner = solve_assignment(cost);

  EarthMovers result;
  result.group = size;
  result.distance_mm.assign(a.size(), std::numeric_limits<float>::quiet_NaN());
  double sum = 0;
  for (size_t i = 0; i < partner.size(); ++i) {
    const double distance = cost(static_cast<Eigen::Index>(i), partner[i]);
    sum += distance;
    const auto& order = a_is_smaller ? from.order : to.order;
    const size_t group = a_is_smaller ? i : partner[i];
    for (size_t k = group * size; k < (group + 1) * size; ++k)
      result.distance_mm[order[k]] = static_cast<float>(distance);
  }
  result.mean_mm = sum / static_cast<double>(partner.size());
  if (size > 1) {
    const size_t matched = from.moved_mm.size();
    result.error_bound_mm = (sum_of_largest(from.moved_mm, matched) + sum_of_largest(to.moved_mm, matched)) /
                            static_cast<double>(matched);
  }
  return result;
}

}  // namespace gantry::internal
