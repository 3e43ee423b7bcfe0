#include "gantry/geometry/mesh_topology.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <numbers>
#include <vector>

#include "joined_vertices.h"

namespace gantry {
namespace {

/// A piece of the mesh, as far as its sides are concerned.
struct Shell {
  Eigen::AlignedBox3d box;
  double volume = 0;  ///< Of the cones from the middle of `box` to its triangles.
  double boundary_length = 0;
  bool oriented = true;
};

/// The lowest vertex of the piece that `vertex` belongs to.
size_t root_of(std::vector<int>& parent, size_t vertex) {
  while (static_cast<size_t>(parent[vertex]) != vertex) {
    parent[vertex] = parent[static_cast<size_t>(parent[vertex])];
    vertex = static_cast<size_t>(parent[vertex]);
  }
  return vertex;
}

/// Whether the volume is negative whatever closes the holes: by the isoperimetric inequality surfaces of at
/// most length^2 / 4 pi can do so, inside the convex hull.
bool faces_inwards(const Shell& shell) {
  const double reach = shell.box.diagonal().norm() / 2;
  const double holes = shell.boundary_length * shell.boundary_length / (4 * std::numbers::pi);
  constexpr double kRounding = 1e-6;
  return shell.oriented && shell.volume < -holes * reach / 3 - kRounding * reach * reach * reach;
}

}  // namespace

MeshTopology analyse_topology(const TriangleMesh& mesh) {
  struct DirectedEdge {
    uint64_t key;  // smaller vertex, larger vertex
    bool forward;
  };
  std::vector<DirectedEdge> edges;
  edges.reserve(3 * mesh.triangles.size());
  const std::vector<int> joined = internal::joined_by_position(mesh.vertices);
  MeshTopology topology;
  std::vector<int> parent = joined;
  for (const Eigen::Vector3i& tri : mesh.triangles)
    for (const int k : {1, 2}) {
      const size_t a = root_of(parent, static_cast<size_t>(tri[0])),
                   b = root_of(parent, static_cast<size_t>(tri[k]));
      parent[std::max(a, b)] = static_cast<int>(std::min(a, b));
    }
  std::map<size_t, Shell> shells;  // by root
  const auto shell_at = [&](size_t vertex) -> Shell& { return shells[root_of(parent, vertex)]; };
  for (const Eigen::Vector3i& tri : mesh.triangles) {
    Shell& shell = shell_at(static_cast<size_t>(tri[0]));
    for (const int v : tri) shell.box.extend(mesh.vertices[static_cast<size_t>(v)].cast<double>());
  }
  for (const Eigen::Vector3i& tri : mesh.triangles) {
    Shell& shell = shell_at(static_cast<size_t>(tri[0]));
    Eigen::Matrix3d corners;
    for (int k = 0; k < 3; ++k)
      corners.col(k) = mesh.vertices[static_cast<size_t>(tri[k])].cast<double>() - shell.box.center();
    shell.volume += corners.determinant() / 6;
  }
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Eigen::Vector3i& tri = mesh.triangles[t];
    if (mesh.area(t) <= 0) ++topology.degenerate_triangles;
    for (int k = 0; k < 3; ++k) {
      const auto a = static_cast<uint64_t>(joined[static_cast<size_t>(tri[k])]);
      const auto b = static_cast<uint64_t>(joined[static_cast<size_t>(tri[(k + 1) % 3])]);
      edges.push_back({std::min(a, b) << 32 | std::max(a, b), a < b});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const auto& x, const auto& y) { return x.key < y.key; });
  for (size_t i = 0; i < edges.size();) {
    size_t j = i;
    int forward = 0;
    for (; j < edges.size() && edges[j].key == edges[i].key; ++j) forward += edges[j].forward;
    const size_t uses = j - i;
    const size_t low = edges[i].key >> 32, high = edges[i].key & 0xffffffff;
    Shell& shell = shell_at(low);
    if (uses == 1) {
      ++topology.boundary_edges;
      shell.boundary_length += (mesh.vertices[low] - mesh.vertices[high]).cast<double>().norm();
    } else if (uses > 2) {
      ++topology.nonmanifold_edges;
      shell.oriented = false;
    } else if (forward != 1) {
      ++topology.inconsistent_edges;
      shell.oriented = false;
    }
    i = j;
  }
  topology.shells = shells.size();
  for (const auto& [root, shell] : shells) {
    if (!faces_inwards(shell)) continue;
    const bool cavity = std::any_of(shells.begin(), shells.end(), [&](const auto& other) {
      return other.second.volume > 0 && other.second.box.contains(shell.box);
    });
    if (!cavity) ++topology.inside_out_shells;
  }
  return topology;
}

std::string MeshTopology::text() const {
  std::string out = watertight() ? "watertight" : "not watertight:";
  if (boundary_edges) out += " " + std::to_string(boundary_edges) + " boundary edges,";
  if (nonmanifold_edges) out += " " + std::to_string(nonmanifold_edges) + " non-manifold edges,";
  if (inconsistent_edges)
    out += " " + std::to_string(inconsistent_edges) + " edges with a flipped neighbour,";
  if (degenerate_triangles)
    out += (watertight() ? ", " : " ") + std::to_string(degenerate_triangles) + " degenerate triangles,";
  if (out.back() == ',') out.pop_back();
  return out;
}

}  // namespace gantry
