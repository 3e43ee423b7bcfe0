#pragma once

#include <random>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/triangle_mesh.h"
#include "geometry/solids.h"

namespace gantry {

inline void add_point(PointCloud& cloud, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
                      float sigma_mm) {
  cloud.points.push_back(point);
  cloud.normals.push_back(normal);
  cloud.sigma_mm.push_back(sigma_mm);
}

/// Points on a grid over all faces of a box, with noise along the normals.
inline PointCloud box_points(const Eigen::Vector3f& low, const Eigen::Vector3f& high, float spacing_mm,
                             float noise_mm, uint32_t seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, 1);
  PointCloud cloud;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    for (const int side : {-1, 1}) {
      const Eigen::Vector3f normal = static_cast<float>(side) * Eigen::Vector3f::Unit(axis);
      for (float a = low[u] + spacing_mm / 2; a < high[u]; a += spacing_mm)
        for (float b = low[v] + spacing_mm / 2; b < high[v]; b += spacing_mm) {
          Eigen::Vector3f p;
          p[axis] = side < 0 ? low[axis] : high[axis];
          p[u] = a;
          p[v] = b;
          add_point(cloud, p + noise_mm * noise(random) * normal, normal, std::max(noise_mm, 1e-3f));
        }
    }
  }
  return cloud;
}

/// Points drawn evenly from a mesh's area, with noise along the normals.
inline PointCloud mesh_points(const TriangleMesh& mesh, size_t count, float noise_mm, uint32_t seed = 1) {
  std::vector<double> areas;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) areas.push_back(mesh.area(t));
  std::mt19937 random(seed);
  std::discrete_distribution<size_t> pick(areas.begin(), areas.end());
  std::uniform_real_distribution<float> uniform(0, 1);
  std::normal_distribution<float> noise(0, 1);
  PointCloud cloud;
  while (cloud.size() < count) {
    const size_t t = pick(random);
    float a = uniform(random), b = uniform(random);
    if (a + b > 1) a = 1 - a, b = 1 - b;
    const auto& corners = mesh.triangles[t];
    const Eigen::Vector3f p0 = mesh.vertices[corners[0]];
    const Eigen::Vector3f p =
        p0 + a * (mesh.vertices[corners[1]] - p0) + b * (mesh.vertices[corners[2]] - p0);
    const Eigen::Vector3f normal = mesh.normal(t);
    add_point(cloud, p + noise_mm * noise(random) * normal, normal, std::max(noise_mm, 1e-3f));
  }
  return cloud;
}

}  // namespace gantry
