#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace gantry::internal {

/// For every row a column of its own such that the costs add up to the least possible: exact, by shortest
/// augmenting paths (Jonker and Volgenant, "A shortest augmenting path algorithm for dense and sparse linear
/// assignment problems", 1987; for more columns than rows Crouse, "On implementing 2D rectangular assignment
/// algorithms", 2016). At least as many columns as rows; all costs finite. O(rows^2 columns).
std::vector<uint32_t> solve_assignment(
    const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>& cost);

}  // namespace gantry::internal
