#include "global_initialisation/k_core.h"

#include <algorithm>

namespace gantry {

std::vector<uint32_t> core_numbers(const Adjacency& graph) {
  const size_t n = graph.size();
  std::vector<uint32_t> degree(n);
  size_t max_degree = 0;
  for (size_t v = 0; v < n; ++v) {
    degree[v] = static_cast<uint32_t>(graph[v].size());
    max_degree = std::max(max_degree, graph[v].size());
  }
  // Vertices sorted by degree; bin_start[d] is where those of degree d begin.
  std::vector<size_t> bin_start(max_degree + 2, 0);
  for (size_t v = 0; v < n; ++v) ++bin_start[degree[v] + 1];
  for (size_t d = 1; d < bin_start.size(); ++d) bin_start[d] += bin_start[d - 1];
  std::vector<uint32_t> sorted(n);
  std::vector<size_t> position(n);
  std::vector<size_t> next = bin_start;
  for (size_t v = 0; v < n; ++v) {
    position[v] = next[degree[v]]++;
    sorted[position[v]] = static_cast<uint32_t>(v);
  }
  // The vertex of least remaining degree has its core number; its neighbours each lose one edge.
  for (size_t i = 0; i < n; ++i) {
    const uint32_t v = sorted[i];
    for (const uint32_t u : graph[v]) {
      if (degree[u] <= degree[v]) continue;
      const size_t first = bin_start[degree[u]];  // swap u with the first of its bin, then shrink the bin
      const uint32_t w = sorted[first];
      std::swap(sorted[position[u]], sorted[first]);
      std::swap(position[u], position[w]);
      ++bin_start[degree[u]];
      --degree[u];
    }
  }
  return degree;
}

std::vector<uint32_t> maximal_core(const Adjacency& graph) {
  const auto cores = core_numbers(graph);
  std::vector<uint32_t> core;
  if (cores.empty()) return core;
  const uint32_t k = *std::max_element(cores.begin(), cores.end());
  for (size_t v = 0; v < cores.size(); ++v)
    if (cores[v] == k) core.push_back(static_cast<uint32_t>(v));
  return core;
}

}  // namespace gantry
