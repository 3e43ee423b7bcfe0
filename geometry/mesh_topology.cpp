#include "gantry/geometry/mesh_topology.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "joined_vertices.h"

namespace gantry {

MeshTopology analyse_topology(const TriangleMesh& mesh) {
  struct DirectedEdge {
    uint64_t key;  // smaller vertex, larger vertex
    bool forward;
  };
  std::vector<DirectedEdge> edges;
  edges.reserve(3 * mesh.triangles.size());
  const std::vector<int> joined = internal::joined_by_position(mesh.vertices);
  MeshTopology topology;
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
    if (uses == 1) ++topology.boundary_edges;
    if (uses == 2 && forward != 1) ++topology.inconsistent_edges;
    if (uses > 2) ++topology.nonmanifold_edges;
    i = j;
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
