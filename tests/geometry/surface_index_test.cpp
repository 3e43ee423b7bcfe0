#include "gantry/geometry/surface_index.h"

#include <gtest/gtest.h>

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

/// With fractions of 200 bits one would compute exactly; long double and the plane from its largest area
/// serve.
double exact_distance_to_sliver(const Vector3f& point, const Vector3f& a, const Vector3f& b,
                                const Vector3f& c) {
  using Vector = Eigen::Matrix<long double, 3, 1>;
  const Vector p = point.cast<long double>(), A = a.cast<long double>(), B = b.cast<long double>(),
               C = c.cast<long double>();
  const Vector n = (B - A).cross(C - A);
  const auto to_segment = [&](const Vector& s, const Vector& e) {
    const long double t = std::clamp<long double>((p - s).dot(e - s) / (e - s).squaredNorm(), 0, 1);
    return (s + t * (e - s) - p).norm();
  };
  const auto left_of = [&](const Vector& s, const Vector& e) { return n.dot((e - s).cross(p - s)) >= 0; };
  if (left_of(A, B) && left_of(B, C) && left_of(C, A))
    return static_cast<double>(std::abs(n.dot(p - A)) / n.norm());
  return static_cast<double>(std::min({to_segment(A, B), to_segment(B, C), to_segment(C, A)}));
}

TEST(SurfaceIndex, SliversAreMeasuredAndHideNothing) {
  // The third corner is a point of the long side, rounded: what fills the gap where tessellations meet.
  std::mt19937 random(8);
  std::uniform_real_distribution<float> uniform(-1, 1);
  const auto vector = [&](float half_size) {
    const float x = uniform(random), y = uniform(random), z = uniform(random);
    return Vector3f(half_size * Vector3f(x, y, z));
  };
  int slivers = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Vector3f a = vector(100), b = a + vector(80), along = b - a;
    const Vector3f c = a + (0.5f + 0.49f * uniform(random)) * along;
    TriangleMesh mesh{{a, b, c}, {{0, 1, 2}}};
    if (mesh.normal(0).isZero() || along.norm() < 1) continue;
    ++slivers;
    // Above the sliver, or around its tips; and a triangle a little further away on the other side.
    const Vector3f above = mesh.normal(0);
    const float height = std::pow(10.0f, 1.5f * uniform(random));
    const Vector3f p = i % 2 == 0
                           ? Vector3f(a + 0.3f * along + height * above)
                           : Vector3f(a - 1e-3f * uniform(random) * along + height * above + vector(0.1f));
    const Vector3f beside = p + 1.02f * height * above;
    for (const Vector3f& corner : {beside, Vector3f(beside + above.unitOrthogonal()),
                                   Vector3f(beside + above.cross(above.unitOrthogonal()) + above)})
      mesh.vertices.push_back(corner);
    mesh.triangles.emplace_back(3, 4, 5);
    const double expected =
        std::min(exact_distance_to_sliver(p, a, b, c),
                 exact_distance_to_sliver(p, mesh.vertices[3], mesh.vertices[4], mesh.vertices[5]));
    const auto closest = SurfaceIndex(mesh).closest(p, 1000);
    ASSERT_TRUE(closest.has_value());
    ASSERT_NEAR(closest->distance, expected, 2e-5) << i;
  }
  EXPECT_GT(slivers, 5000);
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

TEST_F(Tangle, AGuessNeverChangesTheAnswer) {
  const SurfaceIndex surface(mesh_);
  for (int i = 0; i < 5'000; ++i) {
    const Vector3f p = point(), n = vector(1).normalized();
    const auto guess = static_cast<int>(random_() % mesh_.triangles.size());
    for (const float reach : {0.3f, 1000.0f}) {
      const auto a = surface.closest(p, reach), b = surface.closest(p, reach, guess);
      ASSERT_EQ(a.has_value(), b.has_value());
      if (a) {
        ASSERT_EQ(a->triangle, b->triangle);
        ASSERT_EQ(a->point, b->point);
        ASSERT_EQ(a->distance, b->distance);
      }
      const auto c = surface.closest_facing(p, reach, n, 0.5f),
                 d = surface.closest_facing(p, reach, n, 0.5f, guess);
      ASSERT_EQ(c.has_value(), d.has_value());
      if (c) {
        ASSERT_EQ(c->triangle, d->triangle);
      }
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
  cube.triangles.emplace_back(3, 3, 7);
  const SurfaceIndex surface(cube);
  const auto plain = surface.closest({10, 10, 4}, 100);
  for (const int guess : {12, 13, 1'000'000, -7}) {
    const auto guessed = surface.closest({10, 10, 4}, 100, guess);
    EXPECT_EQ(guessed->triangle, plain->triangle) << guess;
  }
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
  std::vector<std::atomic<int>> seen(points.size());
  for_each_run(points, [&](std::span<const uint32_t> run) {
    for (const uint32_t i : run) ++seen[i];
  });
  for (const auto& count : seen) ASSERT_EQ(count, 1);

  const std::vector<uint32_t> order = morton_order(points);
  double sorted = 0, given = 0;
  for (size_t i = 2; i < order.size(); ++i) {
    sorted += (points[order[i]] - points[order[i - 1]]).norm();
    if (i > 10) given += (points[i] - points[i - 1]).norm();
  }
  EXPECT_LT(sorted, 0.1 * given);
  const auto place = [&](uint32_t i) { return std::find(order.begin(), order.end(), i) - order.begin(); };
  EXPECT_EQ(place(9) - place(8), 1);  // of one cell, in the order given
  EXPECT_TRUE(morton_order({}).empty());
}

}  // namespace
}  // namespace gantry
