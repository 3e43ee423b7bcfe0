#include "gantry/geometry/ray_scene.h"

#include <gtest/gtest.h>

#include <random>

#include "foundation/expect_input_error.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

struct BruteHit {
  double distance = 1e300;
  int triangle = -1;
  double u = 0, v = 0;
  bool doubtful = false;  ///< The ray passes so close to an edge that rounding decides.
};

/// First hit by Moeller and Trumbore ("Fast, minimum storage ray/triangle intersection", 1997) in double.
BruteHit brute_cast(const TriangleMesh& mesh, const Eigen::Vector3d& origin,
                    const Eigen::Vector3d& direction) {
  constexpr double kMargin = 1e-4;
  BruteHit best;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Eigen::Vector3d a = mesh.vertices[mesh.triangles[t][0]].cast<double>();
    const Eigen::Vector3d ab = mesh.vertices[mesh.triangles[t][1]].cast<double>() - a;
    const Eigen::Vector3d ac = mesh.vertices[mesh.triangles[t][2]].cast<double>() - a;
    const Eigen::Vector3d p = direction.cross(ac), s = origin - a, q = s.cross(ab);
    const double det = ab.dot(p), u = s.dot(p) / det, v = direction.dot(q) / det, distance = ac.dot(q) / det;
    const double inside = std::min({u, v, 1 - u - v});
    if (distance < 0 || inside < -kMargin || !std::isfinite(inside)) continue;
    if (inside < kMargin || std::abs(det) < 1e-3 * ab.norm() * ac.norm() * direction.norm())
      best.doubtful = true;
    if (inside >= 0 && distance < best.distance) best = {distance, static_cast<int>(t), u, v, best.doubtful};
  }
  return best;
}

class RandomTriangles : public ::testing::Test {
 protected:
  RandomTriangles() {
    for (int t = 0; t < 300; ++t) {
      const Eigen::Vector3f centre = vector(100);
      for (int k = 0; k < 3; ++k) mesh_.vertices.push_back(centre + vector(20));
      mesh_.triangles.emplace_back(3 * t, 3 * t + 1, 3 * t + 2);
    }
  }
  Eigen::Vector3f vector(float half_size) {
    std::uniform_real_distribution<float> uniform(-half_size, half_size);
    const float x = uniform(random_), y = uniform(random_), z = uniform(random_);
    return {x, y, z};
  }

  std::mt19937 random_{2};
  TriangleMesh mesh_;
};

TEST_F(RandomTriangles, CastFindsTheFirstHitOfBruteForce) {
  const RayScene scene(mesh_);
  int hits = 0, misses = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Eigen::Vector3f origin = vector(200), direction = vector(2);
    const BruteHit expected = brute_cast(mesh_, origin.cast<double>(), direction.cast<double>());
    if (expected.doubtful) continue;
    const auto hit = scene.cast(origin, direction);
    ASSERT_EQ(hit.has_value(), expected.triangle >= 0);
    if (!hit) {
      ++misses;
      continue;
    }
    ++hits;
    ASSERT_EQ(hit->triangle, expected.triangle);
    ASSERT_NEAR(hit->distance / expected.distance, 1.0, 1e-4);
    ASSERT_NEAR(hit->u, expected.u, 1e-3);
    ASSERT_NEAR(hit->v, expected.v, 1e-3);
    // In multiples of the direction's length, and not beyond the given distance.
    ASSERT_TRUE(scene.cast(origin, direction, hit->distance * 1.001f).has_value());
    ASSERT_FALSE(scene.cast(origin, direction, hit->distance * 0.999f).has_value());
  }
  EXPECT_GT(hits, 1500);
  EXPECT_GT(misses, 2000);
}

TEST_F(RandomTriangles, OccludedAgreesWithBruteForceOnTheSegment) {
  const RayScene scene(mesh_);
  int blocked = 0, free = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Eigen::Vector3f from = vector(150), to = vector(150);
    const BruteHit hit = brute_cast(mesh_, from.cast<double>(), (to - from).cast<double>());
    if (hit.doubtful || std::abs(hit.distance) < 1e-3 || std::abs(hit.distance - 1) < 1e-3) continue;
    ASSERT_EQ(scene.occluded(from, to), hit.distance < 1);
    ++(hit.distance < 1 ? blocked : free);
  }
  EXPECT_GT(blocked, 2000);
  EXPECT_GT(free, 2000);
}

TEST(RayScene, TheSurfaceItselfDoesNotHideItsOwnPoints) {
  const RayScene scene(box_mesh({0, 0, 0}, {10, 10, 10}));
  const Eigen::Vector3f on_top(3, 4, 10), above(3, 4, 100), below(3, 4, -100);
  EXPECT_FALSE(scene.occluded(above, on_top));
  EXPECT_FALSE(scene.occluded(on_top, above));
  EXPECT_TRUE(scene.occluded(below, on_top));
}

TEST(RayScene, BothSidesOfATriangleAreHit) {
  const RayScene scene({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}});
  EXPECT_TRUE(scene.cast({0.2f, 0.2f, 5}, {0, 0, -1}).has_value());
  EXPECT_TRUE(scene.cast({0.2f, 0.2f, -5}, {0, 0, 1}).has_value());
  EXPECT_FALSE(scene.cast({0.2f, 0.2f, 5}, {0, 0, 1}).has_value());
}

TEST(RayScene, AnEmptyMeshIsRefused) {
  expect_input_error([] { RayScene scene{TriangleMesh{}}; }, {"triangles"});
}

}  // namespace
}  // namespace gantry
