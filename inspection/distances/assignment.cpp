#include "distances/assignment.h"

#include <limits>
#include <numeric>

namespace gantry::internal {
namespace {

constexpr int kNone = -1;

}  // namespace

std::vector<uint32_t> solve_assignment(
    const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>& cost) {
  const auto rows = static_cast<int>(cost.rows()), columns = static_cast<int>(cost.cols());
  // Prices of rows and columns: cost - row price - column price is never negative, and 0 for partners.
  Eigen::VectorXd row_price = Eigen::VectorXd::Zero(rows), column_price = Eigen::VectorXd::Zero(columns);
  std::vector<int> row_of(static_cast<size_t>(columns), kNone), column_of(static_cast<size_t>(rows), kNone);

  // Dijkstra's search from each row in turn to the nearest column without a partner; lengths are reduced
  // costs.
  std::vector<double> length(static_cast<size_t>(columns));
  std::vector<int> reached_from(static_cast<size_t>(columns)), open(static_cast<size_t>(columns)), closed;
  for (int start = 0; start < rows; ++start) {
    std::fill(length.begin(), length.end(), std::numeric_limits<double>::infinity());
    std::iota(open.begin(), open.end(), 0);
    closed.clear();
    auto open_count = static_cast<size_t>(columns);
    int row = start, end = kNone;
    double shortest = 0;
    while (end == kNone) {
      const double* row_cost = &cost(row, 0);
      const double base = shortest - row_price[row];
      double least = std::numeric_limits<double>::infinity();
      size_t next = 0;
      for (size_t k = 0; k < open_count; ++k) {
        const int j = open[k];
        const double candidate = base + row_cost[j] - column_price[j];
        if (candidate < length[j]) {
          length[j] = candidate;
          reached_from[j] = row;
        }
        // Of equally near columns one without a partner ends the search.
        if (length[j] < least || (length[j] == least && row_of[j] == kNone)) {
          least = length[j];
          next = k;
        }
      }
      shortest = least;
      const int column = open[next];
      open[next] = open[--open_count];
      closed.push_back(column);
      if (row_of[column] == kNone)
        end = column;
      else
        row = row_of[column];
    }
    row_price[start] += shortest;
    for (const int j : closed) {
      if (j != end) row_price[row_of[j]] += shortest - length[j];
      column_price[j] -= shortest - length[j];
    }
    for (int column = end; column != kNone;) {
      const int from = reached_from[column];
      row_of[column] = from;
      std::swap(column, column_of[from]);
    }
  }
  return {column_of.begin(), column_of.end()};
}

}  // namespace gantry::internal
