#pragma once

#include <cstdint>
#include <vector>

namespace gantry {

/// An undirected graph without loops: for each vertex its neighbours, ascending.
using Adjacency = std::vector<std::vector<uint32_t>>;

/// For each vertex the largest k such that it belongs to the k-core: the largest subgraph in which
/// every vertex has at least k neighbours. By peeling off the vertex of least degree, in time linear in
/// the edges (Batagelj and Zaversnik 2003, "An O(m) Algorithm for Cores Decomposition of Networks").
std::vector<uint32_t> core_numbers(const Adjacency& graph);

/// The vertices of the non-empty k-core with the largest k, ascending. A clique of n vertices lies in the
/// (n-1)-core, so this is where the largest clique is to be sought, and often it is the clique.
std::vector<uint32_t> maximal_core(const Adjacency& graph);

}  // namespace gantry
