// Optimal assignment and the Earth Mover's distance that rests on it.

#include "distances/assignment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "distances/earth_movers.h"

namespace gantry::internal {
namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Points = std::vector<Eigen::Vector3f>;

double total(const Matrix& cost, const std::vector<uint32_t>& column_of) {
  double sum = 0;
  for (size_t i = 0; i < column_of.size(); ++i) sum += cost(static_cast<Eigen::Index>(i), column_of[i]);
  return sum;
}

/// The least total over all ways there are.
double least_total(const Matrix& cost) {
  std::vector<uint32_t> columns(static_cast<size_t>(cost.cols()));
  std::iota(columns.begin(), columns.end(), 0u);
  double least = std::numeric_limits<double>::infinity();
  do {
    const std::vector<uint32_t> first(columns.begin(), columns.begin() + cost.rows());
    least = std::min(least, total(cost, first));
  } while (std::next_permutation(columns.begin(), columns.end()));
  return least;
}

Matrix distances(const Points& a, const Points& b) {
  Matrix cost(a.size(), b.size());
  for (Eigen::Index i = 0; i < cost.rows(); ++i)
    for (Eigen::Index j = 0; j < cost.cols(); ++j)
      cost(i, j) = (a[static_cast<size_t>(i)] - b[static_cast<size_t>(j)]).cast<double>().norm();
  return cost;
}

Points random_points(size_t count, uint32_t seed, float size = 10) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> coordinate(0, size);
  Points points(count);
  for (auto& p : points) p = {coordinate(random), coordinate(random), coordinate(random)};
  return points;
}

TEST(Assignment, IsTheBestOfAllPermutations) {
  std::mt19937 random(1);
  for (int rows = 1; rows <= 7; ++rows)
    for (int columns = rows; columns <= 7; ++columns)
      for (int trial = 0; trial < 4; ++trial) {
        Matrix cost(rows, columns);
        // Small whole numbers too, negative ones among them: many ties.
        std::uniform_int_distribution<int> whole(-2, 3);
        std::uniform_real_distribution<double> real(0, 1);
        for (auto& c : cost.reshaped()) c = trial % 2 ? whole(random) : real(random);
        const auto found = solve_assignment(cost);
        auto used = found;
        std::sort(used.begin(), used.end());
        EXPECT_EQ(std::unique(used.begin(), used.end()), used.end()) << "a column is used twice";
        EXPECT_NEAR(total(cost, found), least_total(cost), 1e-12) << rows << " x " << columns;
      }
}

TEST(Assignment, OnALineItIsTheMatchingInOrder) {
  std::mt19937 random(2);
  std::normal_distribution<float> left(0, 3), right(1, 5);
  Points a(700), b(700);
  for (auto& p : a) p = {left(random), 0, 0};
  for (auto& p : b) p = {right(random), 0, 0};
  auto in_order = [](Points points) {
    std::sort(points.begin(), points.end(), [](const auto& p, const auto& q) { return p.x() < q.x(); });
    return points;
  };
  const Points a_sorted = in_order(a), b_sorted = in_order(b);
  double expected = 0;
  for (size_t i = 0; i < a.size(); ++i) expected += std::abs(a_sorted[i].x() - b_sorted[i].x());
  EXPECT_NEAR(earth_movers(a, b, 2048).mean_mm, expected / 700, 1e-6);
}

TEST(Assignment, PricesProveThatNoOtherIsBetter) {
  // The same without brute force: the cost of large problems cannot fall when one solves them from the other
  // side, and any two partners swapped cost no less.
  const Matrix cost = distances(random_points(300, 3), random_points(300, 4));
  const auto found = solve_assignment(cost);
  const Matrix turned = cost.transpose();
  EXPECT_NEAR(total(cost, found), total(turned, solve_assignment(turned)), 1e-9);
  for (Eigen::Index i = 0; i < 300; ++i)
    for (Eigen::Index j = 0; j < i; ++j)
      EXPECT_LE(cost(i, found[i]) + cost(j, found[j]), cost(i, found[j]) + cost(j, found[i]) + 1e-12);
}

TEST(EarthMovers, OfAMovedCopyIsTheShiftEvenWhenApproximate) {
  const Points a = random_points(1000, 5);
  Points b = a;
  for (auto& p : b) p += Eigen::Vector3f(0, 3, 4);
  std::shuffle(b.begin(), b.end(), std::mt19937(6));
  const EarthMovers exact = earth_movers(a, b, 1000), approximate = earth_movers(a, b, 125);
  EXPECT_EQ(exact.group, 1u);
  EXPECT_EQ(exact.error_bound_mm, 0);
  EXPECT_NEAR(exact.mean_mm, 5, 1e-5);
  EXPECT_EQ(approximate.group, 8u);
  EXPECT_NEAR(approximate.mean_mm, 5, 1e-5);
}

TEST(EarthMovers, ApproximationKeepsItsBound) {
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    const Points a = random_points(480, seed);
    Points b = random_points(480, 100 + seed, 10 + static_cast<float>(seed));
    for (auto& p : b) p.x() += static_cast<float>(seed % 3);
    const double exact = earth_movers(a, b, 480).mean_mm;
    for (const size_t points : {240, 120, 60, 30}) {
      const EarthMovers approximate = earth_movers(a, b, points);
      ASSERT_EQ(approximate.group, 480 / points);
      EXPECT_LE(std::abs(approximate.mean_mm - exact), approximate.error_bound_mm);
      EXPECT_LT(approximate.error_bound_mm, 12) << "a bound that says nothing";
    }
  }
}

TEST(EarthMovers, ApproximationOfCloudsOfDifferentSizesKeepsItsBound) {
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    const Points a = random_points(240, seed), b = random_points(480, 200 + seed, 12);
    const double exact = earth_movers(a, b, 480).mean_mm;
    const EarthMovers approximate = earth_movers(a, b, 85);  // groups of four
    ASSERT_EQ(approximate.group, 4u);
    EXPECT_LE(std::abs(approximate.mean_mm - exact), approximate.error_bound_mm);
    EXPECT_NEAR(earth_movers(b, a, 85).mean_mm, approximate.mean_mm, 1e-9);
  }
}

TEST(EarthMovers, WhatIsMissingCostsNothing) {
  const Points a = random_points(200, 7);
  const Points part(a.begin() + 30, a.begin() + 150);
  EXPECT_NEAR(earth_movers(part, a, 2048).mean_mm, 0, 1e-12);
  const EarthMovers whole = earth_movers(a, part, 2048);
  EXPECT_NEAR(whole.mean_mm, 0, 1e-12);
  for (size_t i = 0; i < a.size(); ++i)
    EXPECT_EQ(std::isnan(whole.distance_mm[i]), i < 30 || i >= 150) << "point " << i;
}

}  // namespace
}  // namespace gantry::internal
