#include "alignment/tessellation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace gantry::internal {

std::vector<std::array<int, 3>> adjacent_triangles(const TriangleMesh& mesh) {
  // Equal positions share the number of the first.
  std::vector<int> order(mesh.vertices.size()), joined(mesh.vertices.size());
  std::iota(order.begin(), order.end(), 0);
  const auto before = [&](int a, int b) {
    const Eigen::Vector3f &p = mesh.vertices[a], &q = mesh.vertices[b];
    return std::tie(p.x(), p.y(), p.z(), a) < std::tie(q.x(), q.y(), q.z(), b);
  };
  std::sort(order.begin(), order.end(), before);
  for (size_t k = 0; k < order.size(); ++k)
    joined[order[k]] =
        k > 0 && mesh.vertices[order[k]] == mesh.vertices[order[k - 1]] ? joined[order[k - 1]] : order[k];

  struct Side {
    int low, high, triangle, side;
  };
  std::vector<Side> sides;
  sides.reserve(3 * mesh.triangles.size());
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      const int a = joined[mesh.triangles[t][k]], b = joined[mesh.triangles[t][(k + 1) % 3]];
      sides.push_back({std::min(a, b), std::max(a, b), static_cast<int>(t), k});
    }
  std::sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) {
    return std::tie(a.low, a.high, a.triangle, a.side) < std::tie(b.low, b.high, b.triangle, b.side);
  });
  std::vector<std::array<int, 3>> adjacent(mesh.triangles.size(), {-1, -1, -1});
  for (size_t k = 0; k + 1 < sides.size(); ++k) {
    const Side &a = sides[k], &b = sides[k + 1];
    if (a.low != b.low || a.high != b.high) continue;
    adjacent[a.triangle][a.side] = b.triangle;
    adjacent[b.triangle][b.side] = a.triangle;
    ++k;  // of three triangles at an edge the third stays alone
  }
  return adjacent;
}

std::vector<double> facet_angles(const TriangleMesh& mesh, const std::vector<std::array<int, 3>>& adjacent) {
  std::vector<double> angles(mesh.triangles.size(), 0.0);
  for (size_t t = 0; t < angles.size(); ++t)
    for (const int other : adjacent[t]) {
      if (other < 0) continue;
      const double sine =
          0.5 * (mesh.normal(t) - mesh.normal(static_cast<size_t>(other))).cast<double>().norm();
      const double angle = 2 * std::asin(std::min(1.0, sine));
      if (angle < kSmooth_rad) angles[t] = std::max(angles[t], angle / 2);
    }
  return angles;
}

}  // namespace gantry::internal
