#include "joint/coarse.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <numeric>

#include "range_image/simd.h"

namespace gantry::internal {
namespace {

struct Window {
  int left, right, top, bottom;
};

/// Nearest cell in the window whose normal agrees with `n` (within `cosine`); -1 if none nearer than
/// sqrt(limit).
GANTRY_MULTIVERSION int nearest_compatible(const CoarseLevel& level, const Window& window, float px, float py,
                                           float pz, float nx, float ny, float nz, float cosine,
                                           float limit) {
  float best = limit;
  int best_at = -1;
  alignas(64) float distance[64];
  for (int row = window.top; row <= window.bottom; ++row) {
    for (int left = window.left; left <= window.right; left += 64) {
      const int count = std::min(64, window.right - left + 1);
      const int base = row * level.width + left;
      const float* __restrict x = level.x.data() + base;
      const float* __restrict y = level.y.data() + base;
      const float* __restrict z = level.z.data() + base;
      const float* __restrict a = level.nx.data() + base;
      const float* __restrict b = level.ny.data() + base;
      const float* __restrict c = level.nz.data() + base;
      for (int k = 0; k < count; ++k) {
        const float dx = x[k] - px, dy = y[k] - py, dz = z[k] - pz;
        const float dot = a[k] * nx + b[k] * ny + c[k] * nz;
        const float d = dx * dx + dy * dy + dz * dz;
        distance[k] = dot > cosine ? d : 3e38f;
      }
      for (int k = 0; k < count; ++k)
        if (distance[k] < best) {
          best = distance[k];
          best_at = base + k;
        }
    }
  }
  return best_at;
}

struct Gates {
  double scale_mm, reach_mm;
  float cosine;
};

PairSum match_pair(const CoarseLevel& target, const RayModel& rays, const CoarseLevel& source, size_t samples,
                   const Pose& target_from_source, const Pose& part_from_target,
                   const Eigen::Vector3d& centre, const Gates& gates, const CoarseOptions& options) {
  PairSum sum;
  const Eigen::Matrix3f rotation = target_from_source.linear().cast<float>();
  const Eigen::Vector3f shift = target_from_source.translation().cast<float>();
  const double count = static_cast<double>(source.filled.size());
  const size_t used = std::min(samples, source.filled.size());
  const double scale_squared = gates.scale_mm * gates.scale_mm;
  const auto reach_squared = static_cast<float>(gates.reach_mm * gates.reach_mm);
  for (size_t k = 0; k < used; ++k) {
    const int i = source.filled[static_cast<size_t>((k + 0.5) * count / static_cast<double>(used))];
    const Eigen::Vector3f p = rotation * source.point(i) + shift, n = rotation * source.normal(i);
    if (rays.central && p.z() <= 1) continue;
    const Eigen::Vector2d pixel = rays.pixel(rays.ray_of(p.cast<double>())) / target.step;
    // The pitch shrinks with distance as the image of the reach does: near enough for a window.
    const int radius = static_cast<int>(gates.reach_mm / target.spacing_mm) + 1;
    const int column = static_cast<int>(std::floor(std::clamp(pixel.x(), -1e6, 1e6))),
              row = static_cast<int>(std::floor(std::clamp(pixel.y(), -1e6, 1e6)));
    const Window window{std::max(0, column - radius), std::min(target.width - 1, column + radius),
                        std::max(0, row - radius), std::min(target.height - 1, row + radius)};
    if (window.left > window.right || window.top > window.bottom) continue;
    const int j = nearest_compatible(target, window, p.x(), p.y(), p.z(), n.x(), n.y(), n.z(), gates.cosine,
                                     reach_squared);
    if (j < 0) continue;
    const Eigen::Vector3f q = target.point(j), m = target.normal(j);
    const Eigen::Vector3f d = p - q;
    const double loss = scale_squared / (scale_squared + d.squaredNorm());
    double weight = loss * loss * (target.border[j] ? options.border_weight : 1.0);
    if (column >= 0 && row >= 0 && column < target.width && row < target.height) {
      const int seen = row * target.width + column;
      const bool in_front = target.z[seen] != CoarseLevel::kNowhere &&
                            p.z() < target.z[seen] - 2 * static_cast<float>(target.spacing_mm);
      if (in_front || target.empty[seen]) weight *= options.violation_weight;
    }
    const Eigen::Vector3d p_part = part_from_target * p.cast<double>();
    const Eigen::Vector3d arm = p_part - centre;
    const Eigen::Vector3f common = (n + m).normalized();
    const Eigen::Vector3d n_part = part_from_target.linear() * common.cast<double>();
    sum.add(arm, n_part, common.dot(d), weight);
    const Eigen::Vector3d d_part = part_from_target.linear() * d.cast<double>();
    for (int axis = 0; axis < 3; ++axis)
      sum.add(arm, Eigen::Vector3d::Unit(axis), d_part[axis], options.point_share * weight);
  }
  return sum;
}

/// Where a scan has surface, and facing which way: cells of space by the axis nearest to the normal.
std::vector<uint64_t> occupied(const CoarseLevel& level, const Pose& pose, double cell_mm) {
  std::vector<uint64_t> cells;
  for (const int i : level.filled) {
    const Eigen::Vector3d p = pose * level.point(i).cast<double>() / cell_mm;
    const Eigen::Vector3d n = pose.linear() * level.normal(i).cast<double>();
    int axis = 0;
    n.cwiseAbs().maxCoeff(&axis);
    uint64_t key = static_cast<uint64_t>(2 * axis + (n[axis] > 0 ? 1 : 0));
    for (int k = 0; k < 3; ++k)
      key = key << 20 |
            static_cast<uint64_t>(static_cast<int64_t>(std::clamp(std::floor(p[k]), -5e5, 5e5)) & 0xfffff);
    cells.push_back(key);
  }
  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  return cells;
}

std::vector<std::vector<uint64_t>> occupied(const CoarseScans& scans, const Poses& poses, double cell_mm) {
  std::vector<std::vector<uint64_t>> cells(poses.size());
  tbb::parallel_for(size_t{0}, poses.size(),
                    [&](size_t i) { cells[i] = occupied(*scans.levels[i], poses[i], cell_mm); });
  return cells;
}

size_t in_common(const std::vector<uint64_t>& one, const std::vector<uint64_t>& other) {
  std::vector<uint64_t> common;
  std::set_intersection(one.begin(), one.end(), other.begin(), other.end(), std::back_inserter(common));
  return common.size();
}

}  // namespace

Pairs strongest_pairs(std::vector<WeighedPair> candidates, size_t scans, size_t most) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const WeighedPair& a, const WeighedPair& b) { return a.weight > b.weight; });
  std::vector<size_t> partners(scans, 0), parent(scans);
  std::iota(parent.begin(), parent.end(), size_t{0});
  const auto root_of = [&](size_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  Pairs pairs;
  for (const WeighedPair& c : candidates) {
    if (c.weight == 0) break;
    const size_t root_a = root_of(c.a), root_b = root_of(c.b);
    if (root_a == root_b && partners[c.a] >= most && partners[c.b] >= most) continue;
    parent[root_a] = root_b;
    ++partners[c.a];
    ++partners[c.b];
    pairs.emplace_back(c.a, c.b);
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

Pairs likely_pairs(const CoarseScans& scans, const Poses& part_from_grid, double reach_mm, size_t most) {
  const size_t n = scans.levels.size();
  std::vector<WeighedPair> candidates;
  for (size_t a = 0; a < n; ++a)
    for (size_t b = a + 1; b < n; ++b) candidates.push_back({a, b, 1});
  if (n <= most + 1) return strongest_pairs(candidates, n, n);
  const std::vector<std::vector<uint64_t>> cells = occupied(scans, part_from_grid, 2 * reach_mm);
  tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t k) {
    candidates[k].weight = in_common(cells[candidates[k].a], cells[candidates[k].b]);
  });
  return strongest_pairs(std::move(candidates), n, most);
}

std::vector<size_t> partners_of_last(const CoarseScans& scans, const Poses& part_from_grid, double reach_mm,
                                     size_t most) {
  const std::vector<std::vector<uint64_t>> cells = occupied(scans, part_from_grid, 2 * reach_mm);
  std::vector<std::pair<size_t, size_t>> by_weight;  // and place
  for (size_t i = 0; i + 1 < cells.size(); ++i) by_weight.emplace_back(in_common(cells[i], cells.back()), i);
  std::stable_sort(by_weight.begin(), by_weight.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<size_t> partners;
  for (size_t k = 0; k < std::min(most, by_weight.size()); ++k) partners.push_back(by_weight[k].second);
  return partners;
}

void align_coarse(const CoarseScans& scans, const Pairs& pairs, const std::vector<PosePrior>& priors,
                  const Eigen::Vector3d& centre, const CoarseOptions& options, Poses& part_from_grid) {
  const size_t n = scans.levels.size();
  const Slots slots{pairs};
  std::vector<PairSum> sums(slots.count());
  double scale = options.start_mm, angle = options.start_angle_rad;
  for (int at_end = 0; at_end < options.extra_iterations;) {
    const Gates gates{scale, 3 * scale, static_cast<float>(std::cos(angle))};
    tbb::parallel_for(size_t{0}, sums.size(), [&](size_t slot) {
      const size_t target = slots.target(slot), source = slots.source(slot);
      if (!options.fixed.empty() && options.fixed[target] && options.fixed[source]) return;
      sums[slot] = match_pair(*scans.levels[target], *scans.rays[target], *scans.levels[source],
                              options.samples, part_from_grid[target].inverse() * part_from_grid[source],
                              part_from_grid[target], centre, gates, options);
    });
    NormalEquations equations(n);
    for (size_t slot = 0; slot < sums.size(); ++slot) {
      const size_t target = slots.target(slot), source = slots.source(slot);
      if (sums[slot].matches > 0) equations.add_pair(target, source, sums[slot], 1 / (scale * scale));
    }
    const double immovable = 1e6 * equations.hessian().diagonal().maxCoeff();
    for (size_t i = 0; i < n; ++i) {
      if (!options.fixed.empty() && options.fixed[i]) {
        equations.add_prior(i, immovable * Matrix6d::Identity(), Vector6d::Zero());
        continue;
      }
      equations.add_prior(i, priors[i].information,
                          log_about(centre, part_from_grid[i] * priors[i].part_from_grid.inverse()));
    }
    const Eigen::VectorXd step = equations.solve();
    for (size_t i = 0; i < n; ++i)
      part_from_grid[i] =
          exp_about(centre, step.segment<6>(static_cast<Eigen::Index>(6 * i))) * part_from_grid[i];
    if (scale <= options.end_mm * 1.0001) {
      ++at_end;
    } else {
      scale = std::max(options.end_mm, scale * options.shrink);
      angle = std::max(options.end_angle_rad, angle * std::sqrt(options.shrink));
    }
  }
}

}  // namespace gantry::internal
