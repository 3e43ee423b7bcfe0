#pragma once

#include <Eigen/Core>
#include <vector>

namespace gantry::internal {

/// For every vertex the lowest index of a vertex at exactly the same position: STL, for one, repeats every
/// vertex for every triangle.
std::vector<int> joined_by_position(const std::vector<Eigen::Vector3f>& vertices);

}  // namespace gantry::internal
