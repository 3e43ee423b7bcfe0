#include "pseudonormals.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "joined_vertices.h"

namespace gantry::internal {
namespace {

/// What is left of unit normals that cancel, by rounding, for a total weight of one.
constexpr double kCancelled = 1e-6;

Eigen::Vector3f unit_or_zero(const Eigen::Vector3d& sum, double weights) {
  if (sum.norm() <= kCancelled * weights) return Eigen::Vector3f::Zero();
  return sum.normalized().cast<float>();
}

}  // namespace

Pseudonormals::Pseudonormals(const TriangleMesh& mesh, const std::vector<Eigen::Vector3f>& normals)
    : mesh_(mesh),
      normals_(normals),
      joined_(joined_by_position(mesh.vertices)),
      first_(mesh.vertices.size() + 1, 0) {
  for (const Eigen::Vector3i& tri : mesh.triangles)
    for (const int v : tri) ++first_[static_cast<size_t>(joined_[static_cast<size_t>(v)]) + 1];
  for (size_t v = 1; v < first_.size(); ++v) first_[v] += first_[v - 1];
  around_.resize(3 * mesh.triangles.size());
  std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const int v : mesh.triangles[t])
      around_[next[static_cast<size_t>(joined_[static_cast<size_t>(v)])]++] = static_cast<int>(t);
  vertices_.resize(mesh.vertices.size());
  tbb::parallel_for(size_t{0}, vertices_.size(),
                    [&](size_t v) { vertices_[v] = of_vertex(static_cast<int>(v)); });
}

Pseudonormals::Pseudonormal Pseudonormals::of_vertex(int vertex) const {
  /// A triangle's corner here, and the vertices that follow and precede it.
  struct Corner {
    int next, previous, triangle, k;
    bool operator<(const Corner& o) const {
      return std::pair(next, previous) < std::pair(o.next, o.previous);
    }
    bool operator==(const Corner& o) const { return next == o.next && previous == o.previous; }
  };
  thread_local std::vector<Corner> corners;
  thread_local std::vector<std::pair<int, bool>> ends;  // of the edges from here; of a triangle with area?
  corners.clear();
  ends.clear();
  for (uint32_t i = first_[static_cast<size_t>(vertex)]; i < first_[static_cast<size_t>(vertex) + 1]; ++i) {
    const int t = around_[i];
    for (int k = 0; k < 3; ++k)
      if (at(t, k) == vertex) corners.push_back({at(t, (k + 1) % 3), at(t, (k + 2) % 3), t, k});
  }
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double angles = 0;
  for (const Corner& c : corners) {
    const bool has_area = !normals_[static_cast<size_t>(c.triangle)].isZero();
    ends.emplace_back(c.next, has_area);
    ends.emplace_back(c.previous, has_area);
    if (!has_area) continue;
    const auto corner = [&](int k) {
      return mesh_.vertices[static_cast<size_t>(mesh_.triangles[static_cast<size_t>(c.triangle)][k % 3])]
          .cast<double>();
    };
    const Eigen::Vector3d a = corner(c.k), ab = corner(c.k + 1) - a, ac = corner(c.k + 2) - a,
                          across = ab.cross(ac);
    const double doubled_area = across.norm();
    const double angle = std::atan2(doubled_area, ab.dot(ac));
    sum += angle / doubled_area * across;
    angles += angle;
  }
  std::sort(ends.begin(), ends.end());
  bool at_border = false;
  for (size_t i = 0, j = 0; i < ends.size(); i = j) {
    while (j < ends.size() && ends[j].first == ends[i].first) ++j;
    at_border |= j - i == 1 && ends[i].second;
  }
  return {unit_or_zero(sum, angles), at_border};
}

Pseudonormals::Pseudonormal Pseudonormals::of_edge(int triangle, int side) const {
  const int a = at(triangle, side), b = at(triangle, (side + 1) % 3);
  const auto triangles_at = [&](int v) {
    return std::span(around_).subspan(first_[static_cast<size_t>(v)],
                                      first_[static_cast<size_t>(v) + 1] - first_[static_cast<size_t>(v)]);
  };
  const auto around_a = triangles_at(a), around_b = triangles_at(b);
  thread_local std::vector<std::pair<int, int>> seen;  // where each runs, and its third corner
  seen.clear();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (const int t : around_a.size() <= around_b.size() ? around_a : around_b) {
    for (int k = 0; k < 3; ++k) {
      const int from = at(t, k), to = at(t, (k + 1) % 3);
      if (!((from == a && to == b) || (from == b && to == a))) continue;
      const std::pair corners(from, at(t, (k + 2) % 3));
      if (std::find(seen.begin(), seen.end(), corners) != seen.end()) continue;
      seen.push_back(corners);
      const Eigen::Vector3f& n = normals_[static_cast<size_t>(t)];
      sum += n.cast<double>();
      count += n.isZero() ? 0 : 1;
    }
  }
  return {unit_or_zero(sum, count), seen.size() == 1 && count == 1};
}

Pseudonormals::Pseudonormal Pseudonormals::of(int triangle, TriangleFeature feature) const {
  if (feature == TriangleFeature::kFace) return {normals_[static_cast<size_t>(triangle)], false};
  if (feature < TriangleFeature::kVertex0)
    return of_edge(triangle, static_cast<int>(feature) - static_cast<int>(TriangleFeature::kEdge01));
  const int k = static_cast<int>(feature) - static_cast<int>(TriangleFeature::kVertex0);
  return vertices_[static_cast<size_t>(at(triangle, k))];
}

}  // namespace gantry::internal
