#include "pseudonormals.h"

#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>

namespace gantry::internal {
namespace {

/// For every vertex the lowest index of a vertex at the same position.
std::vector<int> joined_by_position(const std::vector<Eigen::Vector3f>& vertices) {
  const size_t slots = std::bit_ceil(2 * vertices.size() + 1);
  std::vector<int> table(slots, -1), joined(vertices.size());
  for (size_t i = 0; i < vertices.size(); ++i) {
    uint64_t hash = 0;
    for (const float c : vertices[i])
      hash = (hash ^ std::bit_cast<uint32_t>(c + 0.0f)) * 0x9e3779b97f4a7c15u;  // -0 is 0
    size_t slot = (hash >> 20) & (slots - 1);
    while (table[slot] >= 0 && vertices[static_cast<size_t>(table[slot])] != vertices[i])
      slot = (slot + 1) & (slots - 1);
    if (table[slot] < 0) table[slot] = static_cast<int>(i);
    joined[i] = table[slot];
  }
  return joined;
}

Eigen::Vector3d corner(const TriangleMesh& mesh, int triangle, int k) {
  return mesh.vertices[static_cast<size_t>(mesh.triangles[static_cast<size_t>(triangle)][k])].cast<double>();
}

}  // namespace

Pseudonormals::Pseudonormals(const TriangleMesh& mesh)
    : mesh_(mesh), joined_(joined_by_position(mesh.vertices)), first_(mesh.vertices.size() + 1, 0) {
  for (const Eigen::Vector3i& tri : mesh.triangles)
    for (const int v : tri) ++first_[static_cast<size_t>(joined_[static_cast<size_t>(v)]) + 1];
  for (size_t v = 1; v < first_.size(); ++v) first_[v] += first_[v - 1];
  around_.resize(3 * mesh.triangles.size());
  std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const int v : mesh.triangles[t])
      around_[next[static_cast<size_t>(joined_[static_cast<size_t>(v)])]++] = static_cast<int>(t);

  vertex_normals_.assign(mesh.vertices.size(), Eigen::Vector3f::Zero());
  vertex_at_border_.assign(mesh.vertices.size(), 0);
  tbb::parallel_for(size_t{0}, mesh.vertices.size(), [&](size_t v) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (uint32_t i = first_[v]; i < first_[v + 1]; ++i) {
      const int t = around_[i];
      for (int k = 0; k < 3; ++k) {
        if (joined_[static_cast<size_t>(mesh.triangles[static_cast<size_t>(t)][k])] != static_cast<int>(v))
          continue;
        const Eigen::Vector3d a = corner(mesh, t, k), ab = corner(mesh, t, (k + 1) % 3) - a,
                              ac = corner(mesh, t, (k + 2) % 3) - a, across = ab.cross(ac);
        sum += std::atan2(across.norm(), ab.dot(ac)) * across.stableNormalized();
        for (const int side : {k, (k + 2) % 3})
          if (edge(t, side).triangles == 1) vertex_at_border_[v] = 1;
      }
    }
    vertex_normals_[v] = sum.stableNormalized().cast<float>();
  });
}

Pseudonormals::Edge Pseudonormals::edge(int triangle, int side) const {
  const Eigen::Vector3i& tri = mesh_.triangles[static_cast<size_t>(triangle)];
  auto here = static_cast<size_t>(joined_[static_cast<size_t>(tri[side])]),
       there = static_cast<size_t>(joined_[static_cast<size_t>(tri[(side + 1) % 3])]);
  if (first_[here + 1] - first_[here] > first_[there + 1] - first_[there]) std::swap(here, there);
  Edge edge{Eigen::Vector3d::Zero(), 0};
  for (uint32_t i = first_[here]; i < first_[here + 1]; ++i) {
    const auto t = static_cast<size_t>(around_[i]);
    for (const int v : mesh_.triangles[t]) {
      if (static_cast<size_t>(joined_[static_cast<size_t>(v)]) != there) continue;
      const Eigen::Vector3f n = mesh_.normal(t);
      if (n.isZero()) continue;
      edge.normals += n.cast<double>();
      ++edge.triangles;
    }
  }
  return edge;
}

Pseudonormals::Pseudonormal Pseudonormals::of(int triangle, TriangleFeature feature) const {
  if (feature == TriangleFeature::kFace) return {mesh_.normal(static_cast<size_t>(triangle)), false};
  if (feature < TriangleFeature::kVertex0) {
    const Edge e = edge(triangle, static_cast<int>(feature) - static_cast<int>(TriangleFeature::kEdge01));
    return {e.normals.stableNormalized().cast<float>(), e.triangles == 1};
  }
  const int k = static_cast<int>(feature) - static_cast<int>(TriangleFeature::kVertex0);
  const auto v =
      static_cast<size_t>(joined_[static_cast<size_t>(mesh_.triangles[static_cast<size_t>(triangle)][k])]);
  return {vertex_normals_[v], vertex_at_border_[v] != 0};
}

}  // namespace gantry::internal
