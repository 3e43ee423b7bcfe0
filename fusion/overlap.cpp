#include "gantry/fusion/overlap.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace gantry {
namespace {

/// Sorted keys of the occupied cells: position, and which of the six main directions the normal is nearest
/// to.
std::vector<uint64_t> occupied_cells(const ScanSurface& surface, double cell_mm) {
  std::vector<uint64_t> cells;
  const Pose& pose = surface.part_from_sensor.mean;
  const size_t stride = std::max<size_t>(1, surface.cloud.size() / 50000);
  for (size_t i = 0; i < surface.cloud.size(); i += stride) {
    const Eigen::Vector3d p = pose * surface.cloud.points[i].cast<double>() / cell_mm;
    const Eigen::Vector3d n = pose.linear() * surface.cloud.normals[i].cast<double>();
    Eigen::Index axis;
    n.cwiseAbs().maxCoeff(&axis);
    const auto direction = static_cast<uint64_t>(2 * axis + (n[axis] < 0));
    uint64_t key = direction;
    for (int k = 0; k < 3; ++k) {
      const auto coordinate = static_cast<int64_t>(std::floor(p[k])) + (1 << 19);
      key = key << 20 | (static_cast<uint64_t>(coordinate) & 0xFFFFF);
    }
    cells.push_back(key);
  }
  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  return cells;
}

size_t common(const std::vector<uint64_t>& a, const std::vector<uint64_t>& b) {
  size_t count = 0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (*i == *j) ++count;
    const bool advance_i = *i <= *j, advance_j = *j <= *i;
    i += advance_i;
    j += advance_j;
  }
  return count;
}

}  // namespace

double predicted_overlap(const ScanSurface& a, const ScanSurface& b, double cell_mm) {
  const std::vector<uint64_t> cells_a = occupied_cells(a, cell_mm), cells_b = occupied_cells(b, cell_mm);
  const size_t smaller = std::max<size_t>(1, std::min(cells_a.size(), cells_b.size()));
  return static_cast<double>(common(cells_a, cells_b)) / static_cast<double>(smaller);
}

}  // namespace gantry
