#include "gantry/fusion/sampling.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "gantry/geometry/pose.h"

namespace gantry {
namespace {

/// A random subset, by a partial Fisher-Yates shuffle that does not depend on the standard library's choice
/// of distribution.
void keep_random(std::vector<uint32_t>& points, size_t count, std::mt19937& random) {
  count = std::min(count, points.size());
  for (size_t k = 0; k < count; ++k)
    std::swap(points[k], points[k + (static_cast<uint64_t>(random()) * (points.size() - k) >> 32)]);
  points.resize(count);
}

/// One random point of each cell; the cell is widened or narrowed until about `count` are occupied.
std::vector<uint32_t> uniform(const ScanSurface& surface, std::vector<uint32_t> candidates, size_t count,
                              std::mt19937& random) {
  Eigen::AlignedBox3f box;
  for (const uint32_t i : candidates) box.extend(surface.cloud.points[i]);
  keep_random(candidates, candidates.size(), random);
  // A surface of n points with spacing s covers about n s^2.
  double cell_mm = std::max(1e-6, surface.spacing_mm) *
                   std::sqrt(static_cast<double>(candidates.size()) / static_cast<double>(count));
  cell_mm = std::max(cell_mm, static_cast<double>(box.sizes().maxCoeff()) / (1 << 20));
  std::vector<uint32_t> chosen;
  for (int round = 0; round < 4; ++round) {
    std::vector<std::pair<uint64_t, uint32_t>> cells;
    cells.reserve(candidates.size());
    for (uint32_t k = 0; k < candidates.size(); ++k) {
      const Eigen::Vector3f p =
          (surface.cloud.points[candidates[k]] - box.min()) / static_cast<float>(cell_mm);
      uint64_t key = 0;
      for (int axis = 0; axis < 3; ++axis) key = key << 21 | static_cast<uint64_t>(p[axis]);
      cells.emplace_back(key, k);
    }
    std::sort(cells.begin(), cells.end());
    chosen.clear();
    for (size_t c = 0; c < cells.size(); ++c)
      if (c == 0 || cells[c].first != cells[c - 1].first) chosen.push_back(candidates[cells[c].second]);
    const double ratio = static_cast<double>(chosen.size()) / static_cast<double>(count);
    if (ratio >= 1 && ratio < 1.2) break;
    cell_mm *= std::sqrt(ratio / 1.1);
  }
  keep_random(chosen, count, random);
  return chosen;
}

std::vector<uint32_t> by_normals(const ScanSurface& surface, const std::vector<uint32_t>& candidates,
                                 size_t count, std::mt19937& random) {
  std::map<int, std::vector<uint32_t>> bins;
  const auto cell = [](float x) { return std::clamp(static_cast<int>((x + 1.0f) * 2.5f), 0, 4); };
  for (const uint32_t i : candidates) {
    const Eigen::Vector3f& n = surface.cloud.normals[i];
    bins[cell(n.x()) * 25 + cell(n.y()) * 5 + cell(n.z())].push_back(i);
  }
  std::vector<std::vector<uint32_t>*> order;
  for (auto& [key, members] : bins) order.push_back(&members);
  std::stable_sort(order.begin(), order.end(), [](auto* a, auto* b) { return a->size() < b->size(); });
  // Small bins give all they have; what they leave is shared among the larger ones.
  std::vector<uint32_t> chosen;
  for (size_t b = 0; b < order.size(); ++b) {
    keep_random(*order[b], (count - chosen.size()) / (order.size() - b), random);
    chosen.insert(chosen.end(), order[b]->begin(), order[b]->end());
  }
  return chosen;
}

/// Points of low leverage are dropped a fifth at a time and the leverages of the rest computed anew.
/// Taking the greatest of the first round instead would crowd all points into one far corner.
std::vector<uint32_t> by_leverage(const ScanSurface& surface, const std::vector<uint32_t>& candidates,
                                  size_t count, std::mt19937& random) {
  std::vector<uint32_t> chosen = uniform(surface, candidates, std::min(candidates.size(), 8 * count), random);
  std::sort(chosen.begin(), chosen.end());
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const uint32_t i : chosen) centre += surface.cloud.points[i].cast<double>();
  centre /= static_cast<double>(chosen.size());
  const auto row = [&](uint32_t i) {
    const Eigen::Vector3d n = surface.cloud.normals[i].cast<double>();
    Vector6d a;
    a << (surface.cloud.points[i].cast<double>() - centre).cross(n), n;
    return a;
  };
  std::vector<std::pair<double, uint32_t>> leverage;
  while (chosen.size() > count) {
    Matrix6d normal = Matrix6d::Zero();
    for (const uint32_t i : chosen) {
      const Vector6d a = row(i);
      normal += a * a.transpose();
    }
    // What the surface leaves free altogether must not make every point infinitely important.
    const Vector6d regular = 1e-9 * normal.diagonal() + Vector6d::Constant(1e-12);
    normal.diagonal() += regular;
    const Eigen::LDLT<Matrix6d> solver(normal);
    leverage.clear();
    for (const uint32_t i : chosen) {
      const Vector6d a = row(i);
      leverage.emplace_back(-a.dot(solver.solve(a)), i);
    }
    std::sort(leverage.begin(), leverage.end());
    leverage.resize(std::max(count, chosen.size() * 4 / 5));
    chosen.clear();
    for (const auto& [minus, i] : leverage) chosen.push_back(i);
  }
  return chosen;
}

}  // namespace

std::string_view to_string(SamplingStrategy strategy) {
  switch (strategy) {
    case SamplingStrategy::kUniform:
      return "uniform";
    case SamplingStrategy::kRandom:
      return "random";
    case SamplingStrategy::kNormalSpace:
      return "normal-space";
    case SamplingStrategy::kMaximumLeverage:
      return "maximum-leverage";
  }
  return "unknown";
}

std::vector<uint32_t> sample_points(const ScanSurface& surface, SamplingStrategy strategy, size_t count) {
  std::vector<uint32_t> candidates;
  for (uint32_t i = 0; i < surface.cloud.size(); ++i)
    if (!surface.rim[i]) candidates.push_back(i);
  if (count == 0 || count >= candidates.size()) return candidates;
  std::mt19937 random(1);
  switch (strategy) {
    case SamplingStrategy::kUniform:
      candidates = uniform(surface, std::move(candidates), count, random);
      break;
    case SamplingStrategy::kRandom:
      keep_random(candidates, count, random);
      break;
    case SamplingStrategy::kNormalSpace:
      candidates = by_normals(surface, candidates, count, random);
      break;
    case SamplingStrategy::kMaximumLeverage:
      candidates = by_leverage(surface, candidates, count, random);
      break;
  }
  std::sort(candidates.begin(), candidates.end());
  return candidates;
}

}  // namespace gantry
