#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry::testing {

using Triangle3 = std::array<Eigen::Vector3d, 3>;

inline double segment_distance(const Eigen::Vector3d& p, const Eigen::Vector3d& p_end,
                               const Eigen::Vector3d& q, const Eigen::Vector3d& q_end) {
  // The square of the distance is convex in the two parameters: descend along one at a time, exactly.
  const Eigen::Vector3d u = p_end - p, v = q_end - q;
  const auto along = [](const Eigen::Vector3d& point, const Eigen::Vector3d& start,
                        const Eigen::Vector3d& d) {
    return d.squaredNorm() > 0 ? std::clamp((point - start).dot(d) / d.squaredNorm(), 0.0, 1.0) : 0.0;
  };
  double best = std::numeric_limits<double>::infinity();
  // Candidates: ends against the other segment, and where the lines are nearest.
  for (const double s : {0.0, 1.0})
    best = std::min(best, (p + s * u - q - along(p + s * u, q, v) * v).norm());
  for (const double t : {0.0, 1.0})
    best = std::min(best, (q + t * v - p - along(q + t * v, p, u) * u).norm());
  Eigen::Matrix<double, 3, 2> a;
  a << u, -v;
  const Eigen::Vector2d st = a.colPivHouseholderQr().solve(q - p);
  if (st.minCoeff() >= 0 && st.maxCoeff() <= 1) best = std::min(best, (p + st[0] * u - q - st[1] * v).norm());
  return best;
}

/// Distance of a point from a triangle's inside, along the normal; infinity beside it.
inline double plane_distance(const Eigen::Vector3d& point, const Triangle3& t) {
  const Eigen::Vector3d n = (t[1] - t[0]).cross(t[2] - t[0]).normalized();
  for (size_t k = 0; k < 3; ++k)
    if ((t[(k + 1) % 3] - t[k]).cross(point - t[k]).dot(n) < 0)
      return std::numeric_limits<double>::infinity();
  return std::abs((point - t[0]).dot(n));
}

inline bool crosses(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Triangle3& t) {
  const Eigen::Vector3d n = (t[1] - t[0]).cross(t[2] - t[0]);
  const double da = (a - t[0]).dot(n), db = (b - t[0]).dot(n);
  if (da * db > 0 || da == db) return false;
  return plane_distance(a + da / (da - db) * (b - a), t) < std::numeric_limits<double>::infinity();
}

inline double triangle_distance(const Triangle3& a, const Triangle3& b) {
  double best = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < 3; ++i) {
    if (crosses(a[i], a[(i + 1) % 3], b) || crosses(b[i], b[(i + 1) % 3], a)) return 0;
    best = std::min({best, plane_distance(a[i], b), plane_distance(b[i], a)});
    for (size_t j = 0; j < 3; ++j)
      best = std::min(best, segment_distance(a[i], a[(i + 1) % 3], b[j], b[(j + 1) % 3]));
  }
  return best;
}

/// Smallest distance of the surfaces, by comparing all triangles; 0 where they cross.
inline double brute_distance(const TriangleMesh& a, const TriangleMesh& b) {
  const auto triangle = [](const TriangleMesh& mesh, const Eigen::Vector3i& t) -> Triangle3 {
    const auto corner = [&](int k) { return mesh.vertices[static_cast<size_t>(t[k])].cast<double>().eval(); };
    return {corner(0), corner(1), corner(2)};
  };
  double best = std::numeric_limits<double>::infinity();
  for (const auto& s : a.triangles) {
    for (const auto& t : b.triangles) {
      const Triangle3 first = triangle(a, s), second = triangle(b, t);
      // Spheres about the first corners spare what cannot be nearest.
      const auto radius = [](const Triangle3& c) {
        return std::max((c[1] - c[0]).norm(), (c[2] - c[0]).norm());
      };
      if ((first[0] - second[0]).norm() - radius(first) - radius(second) > best) continue;
      best = std::min(best, triangle_distance(first, second));
    }
  }
  return best;
}

}  // namespace gantry::testing
