#include "gantry/geometry/surface_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <numbers>
#include <random>

#include "foundation/expect_input_error.h"
#include "gantry/geometry/spatial_order.h"
#include "geometry/brute_distance.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

using Eigen::Vector3f;

/// Triangles of all shapes: ordinary, needles, slivers whose corners hardly leave a line, tiny and huge.
class Tangle : public ::testing::Test {
 protected:
  Tangle() {
    for (int t = 0; t < 2000; ++t) {
      const float size = std::pow(10.0f, uniform(-2, t % 50 == 0 ? 3.0f : 1.2f));
      const Vector3f a = vector(100), along = size * vector(1);
      const Vector3f c = t % 3 == 0   ? Vector3f(a + size * vector(1))
                         : t % 3 == 1 ? Vector3f(a + uniform(-1, 2) * along + 1e-4f * size * vector(1))
                                      : Vector3f(a + along + 1e-3f * size * vector(1));
      for (const Vector3f& corner : {a, Vector3f(a + along), c}) mesh_.vertices.push_back(corner);
      mesh_.triangles.emplace_back(3 * t, 3 * t + 1, 3 * t + 2);
    }
  }
  float uniform(float low, float high) { return std::uniform_real_distribution<float>(low, high)(random_); }
  Vector3f vector(float half_size) {
    const float x = uniform(-half_size, half_size), y = uniform(-half_size, half_size),
                z = uniform(-half_size, half_size);
    return {x, y, z};
  }
  /// Near a triangle, or anywhere.
  Vector3f point() {
    if (random_() % 4 == 0) return vector(150);
    const auto& t = mesh_.triangles[random_() % mesh_.triangles.size()];
    return mesh_.vertices[t[0]] + uniform(0, 1) * (mesh_.vertices[t[1]] - mesh_.vertices[t[0]]) +
           std::pow(10.0f, uniform(-4, 1)) * vector(1);
  }

  std::mt19937 random_{4};
  TriangleMesh mesh_;
};

TEST_F(Tangle, FindsTheDistanceOfBruteForce) {
  const SurfaceIndex surface(mesh_);
  for (int i = 0; i < 20'000; ++i) {
    const Vector3f p = point();
    const double expected = brute_distance(mesh_, p.cast<double>());
    const auto closest = surface.closest(p, 1000);
    ASSERT_TRUE(closest.has_value());
    // What float can say of coordinates of some hundred mm.
    ASSERT_NEAR(closest->distance, expected, 2e-6 + 2e-7 * expected) << p.transpose();
    ASSERT_NEAR((closest->point - p).norm(), expected, 1e-4);
    const auto [a, b, c] = corners(mesh_, static_cast<size_t>(closest->triangle));
    ASSERT_NEAR(distance_to_triangle(p.cast<double>(), a, b, c), expected, 2e-6 + 2e-7 * expected);
  }
}

TEST(SurfaceIndex, FindsTheDistanceOfBruteForceWhereLengthsAreSmall) {
  // Without huge triangles among them the filter in float has to be right to its last digits.
  std::mt19937 random(6);
  std::uniform_real_distribution<float> uniform(-1, 1);
  const auto vector = [&](float half_size) {
    const float x = uniform(random), y = uniform(random), z = uniform(random);
    return Vector3f(half_size * Vector3f(x, y, z));
  };
  TriangleMesh mesh;
  for (int t = 0; t < 30'000; ++t) {  // enough for subtrees to be built as tasks
    const Vector3f a = vector(10);
    for (const Vector3f& corner : {a, Vector3f(a + vector(0.3f)), Vector3f(a + vector(0.3f))})
      mesh.vertices.push_back(corner);
    mesh.triangles.emplace_back(3 * t, 3 * t + 1, 3 * t + 2);
  }
  const SurfaceIndex surface(mesh);
  for (int i = 0; i < 300; ++i) {
    const Vector3f p = vector(i % 2 == 0 ? 10.0f : 30.0f);
    const double expected = brute_distance(mesh, p.cast<double>());
    ASSERT_NEAR(surface.closest(p, 1000)->distance, expected, 1e-7 + 1e-7 * expected) << p.transpose();
  }
}

TEST(SurfaceIndex, ASliverIsMeasuredWhereProductsOfItsSidesLoseAllDigits) {
  // The third corner is a point of the long side, rounded: what fills the gap where tessellations meet. The
  // point lies one mm above it (computed with fractions).
  const SurfaceIndex sliver({{{-47.5581169128418f, -0.6548318862915039f, 20.820899963378906f},
                              {-146.20945739746094f, 4.1830339431762695f, 5.1841654777526855f},
                              {-112.8532943725586f, 2.547246217727661f, 10.471285820007324f}},
                             {{0, 1, 2}}});
  const Vector3f p(-61.80686950683594f, 1.0172390937805176f, 18.792160034179688f);
  const auto closest = sliver.closest(p, 5);
  ASSERT_TRUE(closest.has_value());
  EXPECT_NEAR(closest->distance, 1.0, 1e-6);
  EXPECT_NEAR((closest->point - p).norm(), 1.0, 1e-5);
}

TEST(SurfaceIndex, WhatFloatTakesToBeNearerThanItIsHidesNothing) {
  // Beyond the tip of a needle the foot on its plane seems to lie inside, in float: 1.0000 mm away, where the
  // tip is 1.0013 mm away. Another triangle lies between.
  TriangleMesh mesh{{{-17.604379653930664f, -2.3686399459838867f, 15.857294082641602f},
                     {-27.729032516479492f, -7.000696659088135f, -12.00011920928955f},
                     {-27.72903823852539f, -7.000704288482666f, -12.000115394592285f}},
                    {{0, 1, 2}}};
  const Vector3f p(-18.335111618041992f, -1.717646837234497f, 16.068904876708984f);
  EXPECT_NEAR(SurfaceIndex(mesh).closest(p, 5)->distance, 1.0012694, 1e-6);
  const Vector3f away = (p - mesh.vertices[0]).normalized(), across = away.unitOrthogonal(),
                 at = p + 1.0005f * away;
  for (const Vector3f& corner :
       {Vector3f(at - across), Vector3f(at + across), Vector3f(at + away.cross(across))})
    mesh.vertices.push_back(corner);
  mesh.triangles.emplace_back(3, 4, 5);
  const auto closest = SurfaceIndex(mesh).closest(p, 5);
  EXPECT_EQ(closest->triangle, 1);
  EXPECT_NEAR(closest->distance, 1.0005, 1e-5);
}

TEST_F(Tangle, FarFromTheOriginFindsTheDistanceOfBruteForce) {
  for (Vector3f& v : mesh_.vertices) v += Vector3f(10'000, -20'000, 5'000);
  const SurfaceIndex surface(mesh_);
  for (int i = 0; i < 5'000; ++i) {
    const Vector3f p = vector(150) + Vector3f(10'000, -20'000, 5'000);
    const double expected = brute_distance(mesh_, p.cast<double>());
    ASSERT_NEAR(surface.closest(p, 1000)->distance, expected, 2e-6 + 2e-7 * expected) << p.transpose();
  }
}

void expect_same(const std::optional<SurfaceIndex::Closest>& a,
                 const std::optional<SurfaceIndex::Closest>& b) {
  ASSERT_EQ(a.has_value(), b.has_value());
  if (!a) return;
  ASSERT_EQ(a->triangle, b->triangle);
  ASSERT_EQ(a->point, b->point);
  ASSERT_EQ(a->distance, b->distance);
  ASSERT_EQ(a->feature, b->feature);
}

TEST_F(Tangle, WhatWasLearnedFromOtherQueriesNeverChangesTheAnswer) {
  const SurfaceIndex surface(mesh_);
  SurfaceIndex::Neighbourhood near, near_facing, near_within;
  Vector3f p = point();
  for (int i = 0; i < 20'000; ++i) {
    // Walks of small and of large steps, and jumps.
    p = i % 97 == 0 ? point()
                    : Vector3f(p + std::pow(10.0f, uniform(-3, i % 1000 < 500 ? -1 : 1.5f)) * vector(1));
    const Vector3f n = i % 50 == 0 ? vector(1).normalized() : Vector3f(0.6f, 0, 0.8f);
    const auto anywhere = static_cast<int>(random_() % mesh_.triangles.size());
    ASSERT_NO_FATAL_FAILURE(expect_same(surface.closest(p, 1000), surface.closest(p, 1000, near)));
    ASSERT_NO_FATAL_FAILURE(expect_same(surface.closest(p, 1000), surface.closest(p, 1000, anywhere)));
    ASSERT_NO_FATAL_FAILURE(expect_same(surface.closest(p, 0.3f), surface.closest(p, 0.3f, near_within)));
    ASSERT_NO_FATAL_FAILURE(expect_same(surface.closest_facing(p, 1000, n, 0.5f),
                                        surface.closest_facing(p, 1000, n, 0.5f, near_facing)));
  }
}

TEST(SurfaceIndex, NeighboursOnAFineMeshGetTheAnswersOfAnyPoint) {
  const SurfaceIndex surface(sphere_mesh(25, 200, 100));
  std::mt19937 random(6);
  std::normal_distribution<float> normal;
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  SurfaceIndex::Neighbourhood near, near_facing;
  Vector3f at(25, 0, 0);
  for (int i = 0; i < 50'000; ++i) {
    at = 25 * (at + 0.2f * Vector3f(normal(random), normal(random), normal(random))).normalized();
    const float off = i % 500 == 0 ? 24 : 0.5f * normal(random);
    const Vector3f p = at + off * at.normalized(), n = at.normalized();
    ASSERT_NO_FATAL_FAILURE(expect_same(surface.closest(p, kInfinite), surface.closest(p, kInfinite, near)));
    ASSERT_NO_FATAL_FAILURE(expect_same(surface.closest_facing(p, kInfinite, n, 0.9f),
                                        surface.closest_facing(p, kInfinite, n, 0.9f, near_facing)));
  }
}

TEST(SurfaceIndex, WhatWasLearnedOfOneMeshIsNotTakenForAnother) {
  const SurfaceIndex fine(sphere_mesh(25, 200, 100)), coarse(box_mesh({0, 0, 0}, {10, 10, 10}));
  SurfaceIndex::Neighbourhood near;
  for (int i = 0; i < 200; ++i) {
    const Vector3f p(24 + 0.01f * static_cast<float>(i), 3, 1);
    ASSERT_NO_FATAL_FAILURE(expect_same(fine.closest(p, 100), fine.closest(p, 100, near)));
    if (i % 20 == 19) {
      ASSERT_NO_FATAL_FAILURE(expect_same(coarse.closest(p, 100), coarse.closest(p, 100, near)));
    }
  }
}

TEST_F(Tangle, TheMostDistanceIsKept) {
  const SurfaceIndex surface(mesh_);
  for (int i = 0; i < 5'000; ++i) {
    const Vector3f p = point();
    const float distance = surface.closest(p, 1000)->distance;
    if (distance < 1e-3f) continue;
    ASSERT_TRUE(surface.closest(p, distance * 1.0001f).has_value());
    ASSERT_FALSE(surface.closest(p, distance * 0.9999f).has_value());
  }
}

TEST(SurfaceIndex, OfEquallyCloseTrianglesTheFirstIsTold) {
  // The middle of a regular fan: more equally close triangles than are kept in mind at a time.
  TriangleMesh cone;
  cone.vertices.emplace_back(0, 0, 0);
  constexpr int kSides = 300;
  for (int i = 0; i < kSides; ++i) {
    const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(i) / kSides;
    cone.vertices.emplace_back(10 * std::cos(angle), 10 * std::sin(angle), -10);
  }
  for (int i = 0; i < kSides; ++i) {
    const int k = (i + 137) % kSides;  // the first is not where the search begins
    cone.triangles.emplace_back(0, 1 + k, 1 + (k + 1) % kSides);
  }
  const SurfaceIndex surface(cone);
  for (const int guess : {-1, 0, 17, 299}) {
    const auto tip = surface.closest({0, 0, 3}, 100, guess);
    EXPECT_EQ(tip->triangle, 0);
    EXPECT_EQ(tip->distance, 3);
    EXPECT_EQ(tip->feature, TriangleFeature::kVertex0);
  }
}

TEST(SurfaceIndex, TellsTheFeatureTheClosestPointLiesOn) {
  using Feature = TriangleFeature;
  const SurfaceIndex surface({{{0, 0, 0}, {10, 0, 0}, {0, 10, 0}}, {{0, 1, 2}}});
  const std::vector<std::pair<Vector3f, Feature>> cases = {
      {{2, 2, 3}, Feature::kFace},     {{5, -2, 1}, Feature::kEdge01},   {{7, 7, 1}, Feature::kEdge12},
      {{-2, 5, 1}, Feature::kEdge20},  {{-1, -1, 1}, Feature::kVertex0}, {{15, -1, 1}, Feature::kVertex1},
      {{-1, 15, 1}, Feature::kVertex2}};
  for (const auto& [point, feature] : cases) {
    const auto closest = surface.closest(point, 100);
    ASSERT_TRUE(closest.has_value());
    EXPECT_EQ(closest->feature, feature) << point.transpose();
    EXPECT_NEAR(closest->distance, (closest->point - point).norm(), 1e-5);
  }
}

TEST(SurfaceIndex, PointsThatAreNowhereHaveNoClosestPoint) {
  const SurfaceIndex surface(box_mesh({0, 0, 0}, {10, 10, 10}));
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN(),
                  kInf = std::numeric_limits<float>::infinity();
  for (const Vector3f& p : {Vector3f(kNaN, 0, 0), Vector3f(0, kNaN, kNaN), Vector3f(kInf, 0, 0)})
    for (const int guess : {-1, 3}) EXPECT_FALSE(surface.closest(p, 1e15f, guess).has_value());
  EXPECT_NEAR(surface.closest({1e6f, 5, 5}, 1e15f)->distance, 1e6f - 10, 1);
  EXPECT_TRUE(surface.closest({5, 5, 11}, kInf).has_value());
}

TEST(SurfaceIndex, ManyTrianglesInOnePlaceAreSearchedLikeAnyOthers) {
  TriangleMesh mesh;
  for (int i = 0; i < 50'000; ++i) {
    const int first = static_cast<int>(mesh.vertices.size());
    for (const Vector3f& corner : {Vector3f(0, 0, 0), Vector3f(1, 0, 0), Vector3f(0, 1, 0)})
      mesh.vertices.push_back(corner);
    mesh.triangles.emplace_back(first, first + 1, first + 2);
  }
  const SurfaceIndex surface(mesh);
  const auto closest = surface.closest({0.2f, 0.2f, 5}, 100);
  EXPECT_EQ(closest->triangle, 0);
  EXPECT_EQ(closest->distance, 5);
}

TEST(SurfaceIndex, AGuessThatIsNoTriangleOfItsIsNotFollowed) {
  TriangleMesh cube = box_mesh({0, 0, 0}, {10, 10, 10});
  for (const float x : {20.0f, 30.0f, 24.0f}) cube.vertices.emplace_back(x, 5, 5);
  cube.triangles.emplace_back(8, 9, 10);  // a line that sticks out
  const SurfaceIndex surface(cube);
  for (const int guess : {12, 13, 1'000'000, -7})
    EXPECT_EQ(surface.closest({25, 5, 6}, 100, guess)->distance, 15) << guess;
  EXPECT_FALSE(surface.closest({10, 10, 4}, -5).has_value());
}

TEST(SurfaceIndex, CoordinatesAtTheEndOfFloatAreSearched) {
  TriangleMesh mesh;
  for (int i = 0; i < 20; ++i) {
    const int first = static_cast<int>(mesh.vertices.size());
    const float x = (i % 2 == 0 ? 3e38f : -3e38f) / static_cast<float>(1 + i);
    for (const Vector3f& corner : {Vector3f(x, 0, 0), Vector3f(x, 1, 0), Vector3f(x, 0, 1)})
      mesh.vertices.push_back(corner);
    mesh.triangles.emplace_back(first, first + 1, first + 2);
  }
  EXPECT_NO_THROW(SurfaceIndex(mesh).closest({0, 0, 0}, 1e15f));
}

TEST(SurfaceIndex, AMeshWithoutAreaIsRefused) {
  expect_input_error([] { SurfaceIndex surface{TriangleMesh{}}; }, {"area"});
  expect_input_error(
      [] {
        SurfaceIndex surface{TriangleMesh{{{0, 0, 0}, {1, 1, 1}}, {{0, 1, 0}}}};
      },
      {"area"});
}

TEST(SpatialOrder, RunsHoldEveryPointOnceAndLieTogether) {
  std::mt19937 random(9);
  std::uniform_real_distribution<float> uniform(-50, 50);
  std::vector<Vector3f> points(20'000);
  for (Vector3f& p : points) p = {uniform(random), uniform(random), uniform(random)};
  points[7].x() = std::numeric_limits<float>::quiet_NaN();
  points[8] = points[9];
  points[11] = {1e6f, 1e6f, -1e6f};  // one that is far out must not throw all others together
  std::vector<std::atomic<int>> seen(points.size());
  for_each_run(points, [&](std::span<const uint32_t> run) {
    for (const uint32_t i : run) ++seen[i];
  });
  for (const auto& count : seen) ASSERT_EQ(count, 1);

  const std::vector<uint32_t> order = morton_order(points);
  double sorted = 0, given = 0;
  const auto step = [&](uint32_t a, uint32_t b) {
    return a == 7 || b == 7 || a == 11 || b == 11 ? 0 : (points[a] - points[b]).norm();
  };
  for (uint32_t i = 1; i < order.size(); ++i) {
    sorted += step(order[i], order[i - 1]);
    given += step(i, i - 1);
  }
  EXPECT_LT(sorted, 0.1 * given);
  const auto place = [&](uint32_t i) { return std::find(order.begin(), order.end(), i) - order.begin(); };
  EXPECT_EQ(place(9) - place(8), 1);  // of one cell, in the order given
  EXPECT_TRUE(morton_order({}).empty());
}

TEST(SpatialOrder, AlongALineItGoesForthAndNeverBackByMoreThanACell) {
  std::vector<Vector3f> points;
  for (int i = 0; i < 100'000; ++i) points.emplace_back(0.001f * static_cast<float>(i), 7, 7);
  std::shuffle(points.begin(), points.end(), std::mt19937(11));
  const std::vector<uint32_t> order = morton_order(points);
  float furthest = 0;
  for (const uint32_t i : order) {
    ASSERT_GT(points[i].x(), furthest - 0.16f);
    furthest = std::max(furthest, points[i].x());
  }
}

TEST(SpatialOrder, PointsOfOneCellKeepTheirOrderHoweverManyThereAre) {
  // Clusters far smaller than a cell, of so many points that they are gone through in shares.
  constexpr uint32_t kPoints = 400'000, kClusters = 30;
  std::mt19937 random(10);
  std::uniform_real_distribution<float> uniform(-50, 50);
  std::vector<Vector3f> centres(kClusters), points(kPoints);
  for (Vector3f& c : centres) c = {uniform(random), uniform(random), uniform(random)};
  std::vector<uint32_t> cluster(kPoints);
  for (uint32_t i = 0; i < kPoints; ++i) points[i] = centres[cluster[i] = random() % kClusters];
  const std::vector<uint32_t> order = morton_order(points);
  ASSERT_EQ(order.size(), kPoints);
  size_t changes = 0;
  for (uint32_t k = 1; k < kPoints; ++k) {
    if (cluster[order[k]] != cluster[order[k - 1]]) {
      ++changes;
    } else {
      ASSERT_LT(order[k - 1], order[k]);
    }
  }
  EXPECT_EQ(changes, kClusters - 1);
}

}  // namespace
}  // namespace gantry
