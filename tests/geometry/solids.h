#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// Closed solids to test with; triangles face outwards.

inline TriangleMesh box_mesh(const Eigen::Vector3f& low, const Eigen::Vector3f& high) {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i)
    mesh.vertices.emplace_back(i & 1 ? high.x() : low.x(), i & 2 ? high.y() : low.y(),
                               i & 4 ? high.z() : low.z());
  for (const auto& [a, b, c, d] : {std::array{0, 2, 3, 1}, std::array{4, 5, 7, 6}, std::array{0, 1, 5, 4},
                                   std::array{2, 6, 7, 3}, std::array{0, 4, 6, 2}, std::array{1, 3, 7, 5}}) {
    mesh.triangles.emplace_back(a, b, c);
    mesh.triangles.emplace_back(a, c, d);
  }
  return mesh;
}

/// A prism along x with a sharp edge at the origin: the wedge opens by `angle_rad` towards +y.
inline TriangleMesh wedge_mesh(float half_width, float length, float angle_rad) {
  TriangleMesh mesh;
  const float h = length * std::tan(angle_rad / 2);
  for (const float x : {-half_width, half_width}) {
    mesh.vertices.emplace_back(x, 0, 0);
    mesh.vertices.emplace_back(x, length, -h);
    mesh.vertices.emplace_back(x, length, h);
  }
  mesh.triangles = {{0, 2, 1}, {3, 4, 5}, {0, 1, 4}, {0, 4, 3}, {0, 3, 5}, {0, 5, 2}, {1, 2, 5}, {1, 5, 4}};
  return mesh;
}

/// An icosahedron with a spike on every face: convex tips and ridges, concave valleys.
inline TriangleMesh star_mesh(float valley_radius, float tip_radius) {
  const float g = std::numbers::phi_v<float>;
  TriangleMesh mesh;
  for (const float a : {-1.0f, 1.0f})
    for (const float b : {-g, g}) {
      mesh.vertices.emplace_back(0, a, b);
      mesh.vertices.emplace_back(a, b, 0);
      mesh.vertices.emplace_back(b, 0, a);
    }
  const std::vector<Eigen::Vector3f> corners = mesh.vertices;
  const auto adjacent = [&](int i, int j) {
    return std::abs((corners[i] - corners[j]).norm() - 2.0f) < 1e-3f;
  };
  for (int i = 0; i < 12; ++i)
    for (int j = i + 1; j < 12; ++j)
      for (int k = j + 1; k < 12; ++k) {
        if (!adjacent(i, j) || !adjacent(j, k) || !adjacent(i, k)) continue;
        const Eigen::Vector3f centre = corners[i] + corners[j] + corners[k];
        const bool outwards = (corners[j] - corners[i]).cross(corners[k] - corners[i]).dot(centre) > 0;
        const int b = outwards ? j : k, c = outwards ? k : j, tip = static_cast<int>(mesh.vertices.size());
        mesh.vertices.push_back(centre.normalized() * tip_radius);
        mesh.triangles.emplace_back(i, b, tip);
        mesh.triangles.emplace_back(b, c, tip);
        mesh.triangles.emplace_back(c, i, tip);
      }
  for (int i = 0; i < 12; ++i) mesh.vertices[i] = corners[i].normalized() * valley_radius;
  return mesh;
}

/// A square needle with its tip at the origin, one of whose four sides is a fan of many thin triangles:
/// there a vertex normal that is not weighted by angle points to that side.
inline TriangleMesh uneven_needle_mesh(float half_width, float length, int fan) {
  TriangleMesh mesh;
  mesh.vertices.emplace_back(0, 0, 0);
  mesh.vertices.emplace_back(0, 0, -length);
  for (int i = 0; i < fan; ++i)
    mesh.vertices.emplace_back(half_width, half_width * (2.0f * i / fan - 1), -length);
  mesh.vertices.emplace_back(half_width, half_width, -length);
  mesh.vertices.emplace_back(-half_width, half_width, -length);
  mesh.vertices.emplace_back(-half_width, -half_width, -length);
  const int rim = static_cast<int>(mesh.vertices.size()) - 2;
  for (int i = 0; i < rim; ++i) {
    const int a = 2 + i, b = 2 + (i + 1) % rim;
    mesh.triangles.emplace_back(0, a, b);
    mesh.triangles.emplace_back(1, b, a);
  }
  return mesh;
}

/// Every triangle with its own three vertices, as STL stores them.
/// A sphere around the origin, by degrees of latitude and longitude.
inline TriangleMesh sphere_mesh(float radius, int around, int down) {
  TriangleMesh mesh;
  for (int j = 0; j <= down; ++j) {
    const float latitude = static_cast<float>(M_PI) * static_cast<float>(j) / static_cast<float>(down);
    for (int i = 0; i < around; ++i) {
      const float longitude =
          2 * static_cast<float>(M_PI) * static_cast<float>(i) / static_cast<float>(around);
      mesh.vertices.emplace_back(radius * std::sin(latitude) * std::cos(longitude),
                                 radius * std::sin(latitude) * std::sin(longitude),
                                 radius * std::cos(latitude));
      if (j == down) continue;
      const int here = j * around + i, beside = j * around + (i + 1) % around;
      mesh.triangles.emplace_back(here, here + around, beside);
      mesh.triangles.emplace_back(beside, here + around, beside + around);
    }
  }
  return mesh;
}

inline TriangleMesh split_vertices(const TriangleMesh& mesh) {
  TriangleMesh split;
  for (const auto& t : mesh.triangles) {
    const int first = static_cast<int>(split.vertices.size());
    for (int k = 0; k < 3; ++k) split.vertices.push_back(mesh.vertices[t[k]]);
    split.triangles.emplace_back(first, first + 1, first + 2);
  }
  return split;
}

}  // namespace gantry
