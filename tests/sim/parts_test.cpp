#include "gantry/sim/parts.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <map>
#include <numbers>
#include <random>

#include "gantry/geometry/mesh_topology.h"
#include "gantry/geometry/ray_scene.h"
#include "gantry/geometry/surface_index.h"

namespace gantry {
namespace {

using std::numbers::pi;

const TriangleMesh& lever() {
  static const TriangleMesh mesh = make_slim_lever();
  return mesh;
}
const TriangleMesh& block() {
  static const TriangleMesh mesh = make_prismatic_block();
  return mesh;
}
const TriangleMesh& plate() {
  static const TriangleMesh mesh = make_plate();
  return mesh;
}
const TriangleMesh& turned() {
  static const TriangleMesh mesh = make_revolved_part(RevolvedFeature::kNone);
  return mesh;
}
const TriangleMesh& turned_with_flat() {
  static const TriangleMesh mesh = make_revolved_part(RevolvedFeature::kFlat);
  return mesh;
}
const TriangleMesh& turned_with_bumps() {
  static const TriangleMesh mesh = make_revolved_part(RevolvedFeature::kBumps);
  return mesh;
}

struct Part {
  const char* name;
  const TriangleMesh& (*mesh)();
  Eigen::Vector3f size_mm;
};

// The turned part's shoulder is 80 mm wide; the flat takes 2 mm of it, the bumps add 1.5 mm at 0, 100 and
// 220 degrees: as far as (40 + 1.5) sin(100 degrees) along y.
const Part kParts[] = {{"lever", lever, {160, 35, 18}},
                       {"block", block, {110, 80, 50}},
                       {"plate", plate, {120, 90, 3}},
                       {"turned", turned, {80, 80, 110}},
                       {"turned with flat", turned_with_flat, {78, 80, 110}},
                       {"turned with bumps", turned_with_bumps, {81.5f, 81, 110}}};

TEST(Parts, AreWatertightAndFaceOutwards) {
  for (const Part& part : kParts) {
    SCOPED_TRACE(part.name);
    const MeshTopology topology = analyse_topology(part.mesh());
    EXPECT_TRUE(topology.watertight()) << topology.text();
    EXPECT_EQ(topology.degenerate_triangles, 0u);
    EXPECT_GT(part.mesh().volume(), 0);
    EXPECT_GT(part.mesh().triangles.size(), 50000u);
    EXPECT_LT(part.mesh().triangles.size(), 300000u);
  }
}

TEST(Parts, HaveTheStatedSize) {
  for (const Part& part : kParts) {
    SCOPED_TRACE(part.name);
    const Eigen::Vector3f size = part.mesh().bounds().sizes();
    EXPECT_LT((size - part.size_mm).cwiseAbs().maxCoeff(), 0.2f) << size.transpose();
    EXPECT_LT(part.mesh().bounds().center().norm(), 2);
  }
}

/// Two triangles at an edge never fold back onto each other: no part has a sharper edge than a right angle.
TEST(Parts, HaveNoFoldedTriangles) {
  for (const Part& part : kParts) {
    SCOPED_TRACE(part.name);
    const TriangleMesh& mesh = part.mesh();
    std::map<std::pair<int, int>, size_t> triangle_at;
    for (size_t t = 0; t < mesh.triangles.size(); ++t)
      for (int k = 0; k < 3; ++k) triangle_at[{mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]}] = t;
    float least = 1;
    for (const auto& [edge, t] : triangle_at)
      if (edge.first < edge.second)
        least = std::min(least, mesh.normal(t).dot(mesh.normal(triangle_at.at({edge.second, edge.first}))));
    EXPECT_GT(least, -0.2f);
  }
}

TEST(Parts, AreTheSameEveryTime) {
  const TriangleMesh again = make_plate();
  ASSERT_EQ(again.vertices.size(), plate().vertices.size());
  EXPECT_EQ(std::memcmp(again.vertices.data(), plate().vertices.data(),
                        again.vertices.size() * sizeof(again.vertices[0])),
            0);
  EXPECT_EQ(again.triangles, plate().triangles);
}

/// The furthest that any vertex of the moved (or mirrored) mesh lies from the mesh as it was.
float worst_distance(const TriangleMesh& mesh, const Eigen::Affine3f& motion) {
  const SurfaceIndex surface(mesh);
  float worst = 0;
  for (size_t i = 0; i < mesh.vertices.size(); i += 7) {
    const auto closest = surface.closest(motion * mesh.vertices[i], 100);
    worst = std::max(worst, closest ? closest->distance : 100.0f);
  }
  return worst;
}

Eigen::Affine3f about(const Eigen::Vector3f& centre, const Eigen::Matrix3f& linear) {
  Eigen::Affine3f motion;
  motion.linear() = linear;
  motion.translation() = centre - linear * centre;
  return motion;
}

TEST(Parts, ButForTheTurnedOneHaveNoSymmetry) {
  for (const auto& mesh : {lever(), block(), plate()}) {
    // The plate is symmetric in its thickness: a mirror in z, which no rigid motion makes.
    const bool flat = mesh.bounds().sizes().z() < 4;
    for (const int signs : {1, 2, 3, 4, 5, 6, 7}) {
      if (flat && signs == 4) continue;
      const Eigen::Vector3f diagonal(signs & 1 ? -1 : 1, signs & 2 ? -1 : 1, signs & 4 ? -1 : 1);
      const Eigen::Matrix3f linear = diagonal.asDiagonal();
      EXPECT_GT(worst_distance(mesh, about(mesh.bounds().center(), linear)), 1.4f) << diagonal.transpose();
    }
  }
}

Eigen::Affine3f turn(double degrees) {
  return Eigen::Affine3f(Eigen::AngleAxisf(static_cast<float>(degrees * pi / 180), Eigen::Vector3f::UnitZ()));
}

TEST(RevolvedPart, TurnsIntoItselfOnlyWithoutFeature) {
  for (const double degrees : {10.0, 45.0, 77.7, 180.0})
    EXPECT_LT(worst_distance(turned(), turn(degrees)), 0.001f) << degrees;
  for (const double degrees : {45.0, 90.0, 180.0, 300.0})
    EXPECT_GT(worst_distance(turned_with_flat(), turn(degrees)), 1.9f) << degrees;
  for (const double degrees : {100.0, 120.0, 140.0, 180.0, 220.0, 260.0})
    EXPECT_GT(worst_distance(turned_with_bumps(), turn(degrees)), 1.0f) << degrees;
}

TEST(RevolvedPart, FlatTakesACircularSegmentOfItsWidth) {
  const double half_angle = std::asin(12.5 / 40);
  const double segment_area = 40 * 40 * (half_angle - std::sin(half_angle) * std::cos(half_angle));
  const double length = 34;  // of the shoulder, whose edges are broken by 0.4 mm
  EXPECT_NEAR(turned().volume() - turned_with_flat().volume(), segment_area * length,
              0.02 * segment_area * length);
}

TEST(RevolvedPart, BumpsStandOneAndAHalfMillimetresHigh) {
  const RayScene scene(turned_with_bumps());
  const auto radius_at = [&](double degrees, float z) {
    const double angle = degrees * pi / 180;
    const Eigen::Vector3f outwards(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)),
                                   0);
    const auto hit = scene.cast(100 * outwards + Eigen::Vector3f(0, 0, z), -outwards);
    return hit ? 100 - hit->distance : 0.0f;
  };
  EXPECT_NEAR(radius_at(0, -4), 41.5, 0.02);
  EXPECT_NEAR(radius_at(100, 4), 41.5, 0.02);
  EXPECT_NEAR(radius_at(220, -1), 41.5, 0.02);
  EXPECT_NEAR(radius_at(50, 0), 40, 0.01);
  EXPECT_NEAR(radius_at(160, 0), 40, 0.01);
  EXPECT_NEAR(radius_at(290, 0), 40, 0.01);
}

TEST(Plate, IsThreeMillimetresThickAndHasFiveHoles) {
  struct Hole {
    double x, y, radius;
  };
  constexpr Hole kHoles[] = {{-32, 17, 12}, {36, -22, 8}, {-44, -31, 5}, {47, 32, 3}, {8, 30, 4}};
  const RayScene scene(plate());
  const auto cast = [&](double x, double y, float from_z) {
    return scene.cast({static_cast<float>(x), static_cast<float>(y), from_z},
                      {0, 0, from_z > 0 ? -1.f : 1.f});
  };
  std::mt19937 random(3);
  for (int i = 0; i < 20000; ++i) {
    const double x = -58 + 116 * (random() * 0x1.0p-32), y = -43 + 86 * (random() * 0x1.0p-32);
    double to_wall = 100;  // of the nearest hole; negative inside
    for (const Hole& hole : kHoles)
      to_wall = std::min(to_wall, std::hypot(x - hole.x, y - hole.y) - hole.radius);
    const auto above = cast(x, y, 10), below = cast(x, y, -10);
    if (to_wall < -0.05) {
      EXPECT_FALSE(above || below) << x << " " << y;
    }
    if (to_wall < 1.2) continue;  // the edge is broken
    ASSERT_TRUE(above && below) << x << " " << y;
    EXPECT_NEAR(above->distance, 8.5, 0.001) << x << " " << y;
    EXPECT_NEAR(below->distance, 8.5, 0.001) << x << " " << y;
  }
  double area = 120 * 90 - (4 - pi) * 4 * 4, rim = 2 * (120 + 90) - 8 * 4 + 2 * pi * 4;
  for (const Hole& hole : kHoles) {
    area -= pi * hole.radius * hole.radius;
    rim += 2 * pi * hole.radius;
  }
  EXPECT_NEAR(plate().volume(), 3 * area - 0.5 * 0.5 * rim, 5);
}

TEST(SlimLever, IsDrilledThroughBothBosses) {
  const RayScene scene(lever());
  for (const auto& [x, y, radius] : {std::array{-69.0f, -5.0f, 6.0f}, {72.5f, 9.5f, 3.5f}}) {
    for (int k = 0; k < 8; ++k) {
      const float c = std::cos(static_cast<float>(k)), s = std::sin(static_cast<float>(k));
      const Eigen::Vector3f inside(x + (radius - 0.05f) * c, y + (radius - 0.05f) * s, 50);
      EXPECT_FALSE(scene.cast(inside, {0, 0, -1}));
      const Eigen::Vector3f beside(x + (radius + 1.0f) * c, y + (radius + 1.0f) * s, 50);
      EXPECT_TRUE(scene.cast(beside, {0, 0, -1}));
    }
  }
}

/// Oracle: the same block put together by counting, from the features' own formulas.
TEST(PrismaticBlock, HasTheVolumeOfItsFeatures) {
  const double step = 37 * 80 * 19;           // x from 18, z from 6
  const double chamfer = 0.5 * 14 * 25 * 31;  // below the step
  const double pocket = (46 * 43 - (4 - pi) * 36) * 14;
  const double hole = pi * 49 * 31;
  const double blind_hole = pi * 81 * 22;
  const double expected = 110 * 80 * 50 - step - chamfer - pocket - hole - blind_hole;
  EXPECT_NEAR(block().volume() / expected, 1, 0.002);
}

}  // namespace
}  // namespace gantry
