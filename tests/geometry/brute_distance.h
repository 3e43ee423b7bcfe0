#pragma once

#include <algorithm>
#include <cmath>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

inline double squared_distance_to_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                          const Eigen::Vector3d& b) {
  const double s = std::clamp((p - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
  return (a + s * (b - a) - p).squaredNorm();
}

/// In double, and by another way than the code under test: the plane's distance if the foot is inside,
/// else the nearest of the three sides.
inline double distance_to_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                   const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d n = (b - a).cross(c - a).normalized();
  if ((b - a).cross(p - a).dot(n) >= 0 && (c - b).cross(p - b).dot(n) >= 0 &&
      (a - c).cross(p - c).dot(n) >= 0)
    return std::abs((p - a).dot(n));
  return std::sqrt(std::min({squared_distance_to_segment(p, a, b), squared_distance_to_segment(p, b, c),
                             squared_distance_to_segment(p, c, a)}));
}

struct Corners {
  Eigen::Vector3d a, b, c;
};

inline Corners corners(const TriangleMesh& mesh, size_t t) {
  const Eigen::Vector3i& tri = mesh.triangles[t];
  return {mesh.vertices[tri[0]].cast<double>(), mesh.vertices[tri[1]].cast<double>(),
          mesh.vertices[tri[2]].cast<double>()};
}

/// Over all triangles that have an area.
inline double brute_distance(const TriangleMesh& mesh, const Eigen::Vector3d& p) {
  double best = 1e300;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = corners(mesh, t);
    if (mesh.area(t) > 0) best = std::min(best, distance_to_triangle(p, a, b, c));
  }
  return best;
}

/// Over the triangles whose normals have at least this cosine to the direction.
inline double brute_facing_distance(const TriangleMesh& mesh, const Eigen::Vector3d& p,
                                    const Eigen::Vector3d& direction, double min_cosine) {
  double best = 1e300;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = corners(mesh, t);
    if ((b - a).cross(c - a).normalized().dot(direction) >= min_cosine)
      best = std::min(best, distance_to_triangle(p, a, b, c));
  }
  return best;
}

}  // namespace gantry
