#pragma once

#include <array>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry::internal {

/// Facets bent against each other by less than this are one smooth surface (25 degrees).
constexpr double kSmooth_rad = 0.436;

/// The triangles across the three sides of each; -1 at a border. Vertices are joined by position.
std::vector<std::array<int, 3>> adjacent_triangles(const TriangleMesh& mesh);

/// For each triangle by how much its normal may differ from that of the smooth surface that it stands for:
/// half the largest angle to a neighbour, edges sharper than kSmooth_rad left out (rad).
std::vector<double> facet_angles(const TriangleMesh& mesh, const std::vector<std::array<int, 3>>& adjacent);

}  // namespace gantry::internal
