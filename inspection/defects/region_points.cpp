#include "defects/region_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

namespace gantry::internal {
namespace {

constexpr double kCellMm = 0.5;

/// Union-find.
class Groups {
 public:
  explicit Groups(size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), size_t{0}); }
  size_t root(size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(size_t a, size_t b) { parent_[std::max(root(a), root(b))] = std::min(root(a), root(b)); }

 private:
  std::vector<size_t> parent_;
};

/// A cell of surface: where normals point mostly, and a square across that direction.
using Cell = std::array<int, 4>;

Cell cell_of(const Eigen::Vector3f& p, const Eigen::Vector3f& n, double cell_mm) {
  Eigen::Index axis;
  n.cwiseAbs().maxCoeff(&axis);
  const auto at = [&](Eigen::Index k) { return static_cast<int>(std::floor(p[k] / cell_mm)); };
  return {static_cast<int>(axis), n[axis] < 0, at((axis + 1) % 3), at((axis + 2) % 3)};
}

double tilted_area(const Eigen::Vector3f& n, double cell_mm) {
  return cell_mm * cell_mm / std::max(0.5f, n.cwiseAbs().maxCoeff());
}

double cell_size(const DefectScene& scene) {
  return std::max(kCellMm, 1.2 * scene.surface.spacing_mm);
}

}  // namespace

std::vector<std::vector<size_t>> linked_groups(const std::vector<Eigen::Vector3f>& points, double link_mm) {
  // Coarse cells with a third of the linking distance: cells whose centres are within it are joined.
  const double cell_mm = link_mm / 3;
  std::map<std::array<int, 3>, std::vector<size_t>> cells;
  for (size_t i = 0; i < points.size(); ++i) {
    std::array<int, 3> key;
    for (int k = 0; k < 3; ++k) key[k] = static_cast<int>(std::floor(points[i][k] / cell_mm));
    cells[key].push_back(i);
  }
  std::map<std::array<int, 3>, size_t> number;
  for (const auto& [key, members] : cells) number.emplace(key, number.size());
  Groups groups(cells.size());
  for (const auto& [key, n] : number)
    for (int dx = -3; dx <= 3; ++dx)
      for (int dy = -3; dy <= 3; ++dy)
        for (int dz = -3; dz <= 3; ++dz) {
          if (dx * dx + dy * dy + dz * dz > 9) continue;
          const auto other = number.find({key[0] + dx, key[1] + dy, key[2] + dz});
          if (other != number.end()) groups.join(n, other->second);
        }
  std::map<size_t, std::vector<size_t>> regions;
  for (const auto& [key, members] : cells) {
    auto& region = regions[groups.root(number.at(key))];
    region.insert(region.end(), members.begin(), members.end());
  }
  std::vector<std::vector<size_t>> result;
  for (auto& [root, members] : regions) {
    std::sort(members.begin(), members.end());
    result.push_back(std::move(members));
  }
  return result;
}

std::vector<std::vector<size_t>> regions_out_of_tolerance(const DefectScene& scene) {
  std::vector<size_t> out;
  std::vector<Eigen::Vector3f> feet, places;
  for (size_t i = 0; i < scene.result.deviation_mm.size(); ++i)
    if (std::abs(scene.result.deviation_mm[i]) > scene.options.tolerance_mm) {  // NaN compares false
      out.push_back(i);
      feet.push_back(scene.feet.point[i]);
      places.push_back(scene.result.cloud.points[i]);
    }
  Groups groups(out.size());
  for (const auto* points : {&feet, &places})
    for (const auto& group : linked_groups(*points, scene.options.link_distance_mm))
      for (const size_t k : group) groups.join(group.front(), k);
  std::map<size_t, std::vector<size_t>> regions;
  for (size_t k = 0; k < out.size(); ++k) regions[groups.root(k)].push_back(out[k]);
  std::vector<std::vector<size_t>> result;
  for (auto& [root, members] : regions) result.push_back(std::move(members));
  return result;
}

RegionExtent measure_region(const DefectScene& scene, const std::vector<size_t>& members) {
  RegionExtent extent;
  const double size = cell_size(scene);
  extent.area_mm2 = sampled_area(scene.result.cloud, members, size);
  struct Sum {
    double deviations = 0, count = 0, area = 0;
  };
  std::map<std::pair<size_t, Cell>, Sum> cells;  // of each CAD face
  for (const size_t i : members) {
    if (scene.feet.beside[i]) continue;
    const Eigen::Vector3f normal = scene.foot_normal(i);
    Sum& sum = cells[{scene.face(i), cell_of(scene.feet.point[i], normal, size)}];
    sum.deviations += scene.result.deviation_mm[i];
    sum.area = tilted_area(normal, size);
    ++sum.count;
  }
  for (const auto& [cell, sum] : cells) {
    const double volume = sum.deviations / sum.count * sum.area;
    (volume > 0 ? extent.extra_mm3 : extent.missing_mm3) += std::abs(volume);
  }
  return extent;
}

double sampled_area(const PointCloud& cloud, const std::vector<size_t>& members, double cell_mm) {
  std::map<Cell, double> cells;
  for (const size_t i : members) {
    const Eigen::Vector3f n = cloud.has_normals() ? cloud.normals[i] : Eigen::Vector3f::UnitZ();
    cells.try_emplace(cell_of(cloud.points[i], n, cell_mm), tilted_area(n, cell_mm));
  }
  double area = 0;
  for (const auto& [key, cell_area] : cells) area += cell_area;
  return area;
}

}  // namespace gantry::internal
