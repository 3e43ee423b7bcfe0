#include "distances/delaunay.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace gantry::internal {

void delaunay(std::span<const Eigen::Vector2d> points, std::vector<std::array<int, 3>>& triangles) {
  triangles.clear();
  const auto n = static_cast<int>(points.size());
  if (n < 3) return;
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const auto& p : points) middle += p / n;
  double scale = 0;
  for (const auto& p : points) scale = std::max(scale, (p - middle).norm());
  if (!(scale > 0)) return;
  thread_local std::vector<Eigen::Vector3d> lifted;
  lifted.clear();
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector2d p = (points[i] - middle) / scale;
    // Lifted by a little that differs from point to point, so that no four lie in one plane: points on a grid
    // would otherwise give both diagonals of every square. A sine of whole numbers follows no pattern of
    // theirs.
    lifted.emplace_back(p.x(), p.y(), p.squaredNorm() + 1e-9 * std::sin(1e4 * (i + 1)));
  }
  constexpr double kLeastArea = 1e-12;  // twice the area, of points within a unit circle
  for (int a = 0; a < n; ++a)
    for (int b = a + 1; b < n; ++b)
      for (int c = b + 1; c < n; ++c) {
        Eigen::Vector3d up = (lifted[b] - lifted[a]).cross(lifted[c] - lifted[a]);
        if (std::abs(up.z()) < kLeastArea) continue;
        if (up.z() < 0) up = -up;
        bool lowest = true;
        for (int d = 0; d < n && lowest; ++d)
          lowest = d == a || d == b || d == c || up.dot(lifted[d] - lifted[a]) > 0;
        if (lowest) triangles.push_back({a, b, c});
      }
}

}  // namespace gantry::internal
