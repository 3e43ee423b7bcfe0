#include "defects.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <set>
#include <unordered_map>

namespace gantry::internal {
namespace {

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

/// Which of +-x, +-y, +-z a point's normal is nearest to, as 0 to 5.
size_t main_direction(const PointCloud& cloud, size_t i) {
  if (!cloud.has_normals()) return 0;
  const Eigen::Vector3f& n = cloud.normals[i];
  Eigen::Index axis;
  n.cwiseAbs().maxCoeff(&axis);
  return static_cast<size_t>(2 * axis + (n[axis] < 0));
}

/// Area that points with normals sample: occupied cells of a grid across each point's main direction,
/// each counted with the tilt of its surface. `cell_mm` should exceed the points' spacing.
double sampled_area(const PointCloud& cloud, const std::vector<size_t>& members, double cell_mm) {
  std::map<std::array<int, 5>, double> cells;
  for (size_t i : members) {
    const Eigen::Vector3f n = cloud.has_normals() ? cloud.normals[i] : Eigen::Vector3f::UnitZ();
    Eigen::Index axis;
    n.cwiseAbs().maxCoeff(&axis);
    const Eigen::Vector3f& p = cloud.points[i];
    const auto cell = [&](Eigen::Index k) { return static_cast<int>(std::floor(p[k] / cell_mm)); };
    // Along the main direction the layers are coarse: they only tell one wall from the next.
    const int layer = static_cast<int>(std::floor(p[axis] / (4 * cell_mm)));
    cells.try_emplace({static_cast<int>(axis), n[axis] < 0, cell((axis + 1) % 3), cell((axis + 2) % 3), layer},
                      cell_mm * cell_mm / std::max(0.5f, std::abs(n[axis])));
  }
  double area = 0;
  std::set<std::array<int, 4>> counted;
  for (const auto& [key, cell_area] : cells)
    if (counted.insert({key[0], key[1], key[2], key[3]}).second) area += cell_area;
  return area;
}

}  // namespace

void find_defects(InspectionResult& result, const InspectionOptions& options) {
  const PointCloud& cloud = result.cloud;
  std::vector<size_t> out;
  for (size_t i = 0; i < cloud.size(); ++i)
    if (std::abs(result.deviation_mm[i]) > options.tolerance_mm) out.push_back(i);  // NaN compares false

  // Coarse cells with a third of the linking distance: cells whose centres are within it are joined.
  const double cell_mm = options.link_distance_mm / 3;
  std::map<std::array<int, 3>, std::vector<size_t>> cells;
  for (size_t i : out) {
    std::array<int, 3> key;
    for (int k = 0; k < 3; ++k) key[k] = static_cast<int>(std::floor(cloud.points[i][k] / cell_mm));
    cells[key].push_back(i);
  }
  std::map<std::array<int, 3>, size_t> number;
  for (const auto& [key, members] : cells) number.emplace(key, number.size());
  Groups groups(cells.size());
  for (const auto& [key, n] : number) {
    for (int dx = -3; dx <= 3; ++dx)
      for (int dy = -3; dy <= 3; ++dy)
        for (int dz = -3; dz <= 3; ++dz) {
          if (dx * dx + dy * dy + dz * dz > 9) continue;
          const auto other = number.find({key[0] + dx, key[1] + dy, key[2] + dz});
          if (other != number.end()) groups.join(n, other->second);
        }
  }
  std::map<size_t, std::vector<size_t>> regions;
  for (const auto& [key, members] : cells) {
    auto& region = regions[groups.root(number.at(key))];
    region.insert(region.end(), members.begin(), members.end());
  }

  // The peak is where the deviation is certainly largest: a poorly known rim must not outbid the middle.
  const auto certain_size = [&](size_t i) { return std::abs(result.deviation_mm[i]) - 3 * result.uncertainty_mm[i]; };
  std::vector<std::pair<Defect, std::vector<size_t>>> found;
  for (auto& [root, members] : regions) {
    Defect defect;
    defect.points = members.size();
    defect.area_mm2 = sampled_area(cloud, members, 0.5);
    if (defect.area_mm2 < options.min_defect_area_mm2) continue;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    Eigen::AlignedBox3d box;
    size_t peak = members.front();
    std::array<Eigen::Vector3d, 6> facing;
    facing.fill(Eigen::Vector3d::Zero());
    double magnitudes = 0;
    for (size_t i : members) {
      const Eigen::Vector3d p = cloud.points[i].cast<double>();
      sum += p;
      box.extend(p);
      magnitudes += std::abs(result.deviation_mm[i]);
      if (certain_size(i) > certain_size(peak)) peak = i;
      if (cloud.has_normals()) {
        facing[main_direction(cloud, i)] += cloud.normals[i].cast<double>();
      }
    }
    const double count = static_cast<double>(members.size());
    defect.centre_mm = sum / count;
    defect.extent_mm = box.sizes();
    defect.mean_mm = magnitudes / count;
    defect.peak_mm = result.deviation_mm[peak];
    defect.peak_at_mm = cloud.points[peak].cast<double>();
    defect.uncertainty_mm = 2.0 * result.uncertainty_mm[peak];
    defect.normal = facing[main_direction(cloud, peak)].stableNormalized();
    defect.certain = std::abs(defect.peak_mm) > options.tolerance_mm + defect.uncertainty_mm;
    found.emplace_back(defect, std::move(members));
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return std::abs(a.first.peak_mm) > std::abs(b.first.peak_mm);
  });
  result.defect_id.assign(cloud.size(), 0);
  for (auto& [defect, members] : found) {
    defect.id = static_cast<int>(result.defects.size()) + 1;
    for (size_t i : members) result.defect_id[i] = defect.id;
    result.defects.push_back(defect);
  }
}

}  // namespace gantry::internal
