#include "collision/solid.h"

#include <fcl/narrowphase/distance.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace gantry {
namespace {

/// One vertex of each set of triangles that hang together by their vertices.
std::vector<Eigen::Vector3d> one_vertex_of_each_shell(const TriangleMesh& mesh) {
  std::vector<size_t> parent(mesh.vertices.size());
  std::iota(parent.begin(), parent.end(), size_t{0});
  const auto root = [&parent](size_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (const Eigen::Vector3i& t : mesh.triangles)
    for (int k = 1; k < 3; ++k) parent[root(static_cast<size_t>(t[k]))] = root(static_cast<size_t>(t[0]));
  std::vector<bool> used(mesh.vertices.size(), false);
  std::vector<Eigen::Vector3d> result;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    const size_t shell = root(static_cast<size_t>(t[0]));
    if (used[shell]) continue;
    used[shell] = true;
    result.push_back(mesh.vertices[shell].cast<double>());
  }
  return result;
}

}  // namespace

Solid::Solid(const TriangleMesh& mesh) : mesh_(mesh) {
  std::vector<fcl::Vector3d> vertices;
  for (const Eigen::Vector3f& vertex : mesh.vertices) vertices.push_back(vertex.cast<double>());
  std::vector<fcl::Triangle> triangles;
  for (const Eigen::Vector3i& t : mesh.triangles) {
    triangles.emplace_back(static_cast<size_t>(t[0]), static_cast<size_t>(t[1]), static_cast<size_t>(t[2]));
    for (int k = 0; k < 3; ++k) box_.extend(vertices[static_cast<size_t>(t[k])]);
  }
  hierarchy_.beginModel(static_cast<int>(triangles.size()), static_cast<int>(vertices.size()));
  hierarchy_.addSubModel(vertices, triangles);
  hierarchy_.endModel();

  centre_ = box_.center();
  for (const Eigen::Vector3i& t : mesh.triangles)
    for (int k = 0; k < 3; ++k)
      radius_ = std::max(radius_, (vertices[static_cast<size_t>(t[k])] - centre_).norm());
  for (int k = 0; k < 8; ++k) corners_.col(k) = box_.corner(static_cast<Eigen::AlignedBox3d::CornerType>(k));
  one_of_each_shell_ = one_vertex_of_each_shell(mesh);
}

bool Solid::contains(const Eigen::Vector3d& point) const {
  if (!box_.contains(point)) return false;
  // Solid angles of all triangles (van Oosterom and Strackee, 1983): 4 pi times the winding number.
  double angle = 0;
  for (const Eigen::Vector3i& t : mesh_.triangles) {
    const auto to = [&](int k) {
      return (mesh_.vertices[static_cast<size_t>(t[k])].cast<double>() - point).eval();
    };
    const Eigen::Vector3d a = to(0), b = to(1), c = to(2);
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    angle += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return std::abs(angle) > 2 * std::numbers::pi;
}

double surface_distance(const Solid& a, const Solid& b, const Pose& a_from_b) {
  const fcl::DistanceRequestd request;
  fcl::DistanceResultd result;
  const double distance = fcl::distance(&a.hierarchy_, fcl::Transform3d::Identity(), &b.hierarchy_,
                                        fcl::Transform3d(a_from_b.matrix()), request, result);
  return std::max(0.0, distance);
}

bool one_holds_other(const Solid& a, const Solid& b, const Pose& a_from_b) {
  const Pose b_from_a = a_from_b.inverse();
  return std::any_of(b.one_of_each_shell_.begin(), b.one_of_each_shell_.end(),
                     [&](const Eigen::Vector3d& p) { return a.contains(a_from_b * p); }) ||
         std::any_of(a.one_of_each_shell_.begin(), a.one_of_each_shell_.end(),
                     [&](const Eigen::Vector3d& p) { return b.contains(b_from_a * p); });
}

}  // namespace gantry
