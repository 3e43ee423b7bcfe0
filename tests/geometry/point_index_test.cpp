#include "gantry/geometry/point_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>

namespace gantry {
namespace {

using Neighbour = PointIndex::Neighbour;

constexpr float kFar = std::numeric_limits<float>::infinity();

class PointIndexTest : public ::testing::Test {
 protected:
  PointIndexTest() {
    // On a coarse grid, so that duplicates and equal distances are common.
    for (int i = 0; i < 2000; ++i) points_.push_back(grid_point());
    std::fill_n(points_.begin(), 100, points_.front());
  }
  Eigen::Vector3f grid_point() {
    const auto x = static_cast<float>(random_() % 20), y = static_cast<float>(random_() % 20);
    return {x, y, static_cast<float>(random_() % 20)};
  }
  Eigen::Vector3f query() {
    std::uniform_real_distribution<float> uniform(-5, 25);
    const float x = uniform(random_), y = uniform(random_);
    return {x, y, uniform(random_)};
  }
  std::vector<float> sorted_distances(const Eigen::Vector3f& q) const {
    std::vector<float> squared;
    for (const auto& p : points_) squared.push_back((p - q).squaredNorm());
    std::sort(squared.begin(), squared.end());
    return squared;
  }
  /// Each neighbour is another point and lies where it says.
  void expect_honest(const Eigen::Vector3f& q, const std::vector<Neighbour>& found) const {
    std::vector<uint32_t> indices;
    for (const auto& n : found) {
      ASSERT_LT(n.index, points_.size());
      ASSERT_NEAR(n.squared_distance, (points_[n.index] - q).squaredNorm(), 1e-3);
      indices.push_back(n.index);
    }
    std::sort(indices.begin(), indices.end());
    ASSERT_TRUE(std::adjacent_find(indices.begin(), indices.end()) == indices.end()) << "a point came twice";
  }

  std::mt19937 random_{4};
  std::vector<Eigen::Vector3f> points_;
};

TEST_F(PointIndexTest, NearestAgreesWithBruteForce) {
  const PointIndex index(points_);
  std::vector<Neighbour> found{{7, 7.0f}};  // must be cleared
  for (const size_t k : {size_t{1}, size_t{5}, size_t{150}})
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3f q = i % 3 ? query() : grid_point();
      const std::vector<float> expected = sorted_distances(q);
      index.nearest(q, k, kFar, found);
      ASSERT_EQ(found.size(), k);
      expect_honest(q, found);
      for (size_t j = 0; j < k; ++j) ASSERT_NEAR(found[j].squared_distance, expected[j], 1e-3);
    }
}

TEST_F(PointIndexTest, TheNearestOneDoesNotDependOnTheQueriesBefore) {
  const PointIndex index(points_);
  PointIndex::Neighbourhood near;
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector3f q = i % 3 ? query() : grid_point();
    const float least = sorted_distances(q)[0];
    for (const auto& found : {index.nearest(q, kFar), index.nearest(q, kFar, near)}) {
      ASSERT_TRUE(found);
      expect_honest(q, {*found});
      ASSERT_NEAR(found->squared_distance, least, 1e-3);
    }
    EXPECT_EQ(index.nearest(q, 0.99f * std::sqrt(least)).has_value(), least == 0);
    EXPECT_EQ(index.nearest(q, 0.99f * std::sqrt(least), near).has_value(), least == 0);
    EXPECT_TRUE(index.nearest(points_[200], 0, near)) << "what lies at the maximum distance is within it";
  }
  const PointIndex empty{std::span<const Eigen::Vector3f>()};
  EXPECT_FALSE(empty.nearest({0, 0, 0}, kFar));
  EXPECT_FALSE(empty.nearest({0, 0, 0}, kFar, near));
}

TEST_F(PointIndexTest, NearestStopsAtTheMaximumDistance) {
  const PointIndex index(points_);
  std::vector<Neighbour> found;
  size_t cut = 0;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3f q = query();
    const std::vector<float> expected = sorted_distances(q);
    const auto in_reach =
        static_cast<size_t>(std::lower_bound(expected.begin(), expected.end(), 2.25f) - expected.begin());
    index.nearest(q, 10, 1.5f, found);
    ASSERT_EQ(found.size(), std::min<size_t>(10, in_reach));
    cut += in_reach < 10;
  }
  EXPECT_GT(cut, 20u);
}

TEST_F(PointIndexTest, WithinAgreesWithBruteForce) {
  const PointIndex index(points_);
  std::vector<Neighbour> found{{7, 7.0f}};
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3f q = query();
    const float radius = 0.1f + 0.02f * static_cast<float>(i);
    size_t expected = 0;
    for (const auto& p : points_) expected += (p - q).norm() < radius;
    index.within(q, radius, found);
    ASSERT_EQ(found.size(), expected);
    expect_honest(q, found);
  }
}

TEST_F(PointIndexTest, MoreNeighboursThanPoints) {
  points_.resize(7);
  const PointIndex index(points_);
  std::vector<Neighbour> found;
  index.nearest({1, 2, 3}, 50, kFar, found);
  EXPECT_EQ(found.size(), 7u);
  expect_honest({1, 2, 3}, found);
}

TEST_F(PointIndexTest, ADuplicateIsFoundAtEveryPlaceItIsStored) {
  const PointIndex index(points_);
  std::vector<Neighbour> found;
  index.within(points_.front(), 0.5f, found);
  EXPECT_GE(found.size(), 100u);
  for (const auto& n : found) EXPECT_EQ(n.squared_distance, 0.0f);
}

TEST_F(PointIndexTest, EmptySetAndNoNeighboursWanted) {
  std::vector<Neighbour> found{{7, 7.0f}};
  const PointIndex empty{std::span<const Eigen::Vector3f>{}};
  empty.nearest({0, 0, 0}, 3, kFar, found);
  EXPECT_TRUE(found.empty());
  found = {{7, 7.0f}};
  empty.within({0, 0, 0}, 3, found);
  EXPECT_TRUE(found.empty());
  const PointIndex index(points_);
  found = {{7, 7.0f}};
  index.nearest({0, 0, 0}, 0, kFar, found);
  EXPECT_TRUE(found.empty());
}

TEST_F(PointIndexTest, SurvivesBeingMoved) {
  PointIndex first(points_);
  const PointIndex second = std::move(first);
  std::vector<Neighbour> found;
  second.nearest(points_[500], 1, kFar, found);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].squared_distance, 0.0f);
}

}  // namespace
}  // namespace gantry
