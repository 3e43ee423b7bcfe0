#include "gantry/sim/bracket.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/mesh_topology.h"
#include "gantry/geometry/signed_distance.h"

namespace gantry {
namespace {

const std::filesystem::path kParts = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples/parts";

const TriangleMesh& good() {
  static const TriangleMesh mesh = make_bracket();
  return mesh;
}

const TriangleMesh& defective() {
  static const TriangleMesh mesh = make_bracket(seeded_defects());
  return mesh;
}

const SignedDistance& distance_to_good() {
  static const SignedDistance distance(good());
  return distance;
}

TEST(Bracket, IsWatertightWithAndWithoutDefects) {
  EXPECT_TRUE(analyse_topology(good()).watertight()) << analyse_topology(good()).text();
  EXPECT_TRUE(analyse_topology(defective()).watertight()) << analyse_topology(defective()).text();
  EXPECT_EQ(analyse_topology(good()).degenerate_triangles, 0u);
  EXPECT_EQ(analyse_topology(defective()).degenerate_triangles, 0u);
}

TEST(Bracket, HasTheStatedSizeAndTheVolumeOfItsSheet) {
  const Eigen::AlignedBox3f box = good().bounds();
  EXPECT_TRUE(box.min().isApprox(Eigen::Vector3f(0, -40, 0), 1e-5f)) << box.min().transpose();
  EXPECT_TRUE(box.max().isApprox(Eigen::Vector3f(120, 40, 60), 1e-5f)) << box.max().transpose();
  // Middle surface times thickness: 55 + 110 + 30 mm flat and two quarter bends of 4 mm, 80 mm wide, less
  // the holes. The bead only shifts the sheet across its face, which keeps the volume.
  using std::numbers::pi;
  const double area = 80 * (55 + 110 + 30 + 2 * 4 * pi / 2) - pi * (10 * 10 + 4 * 4 * 4 + 2 * 3 * 3);
  EXPECT_NEAR(good().volume() / (2 * area), 1, 0.002);
  EXPECT_GT(good().triangles.size(), 30000u);
  EXPECT_LT(good().triangles.size(), 70000u);
}

/// Rays through the sheet, at random places of its three flat regions away from holes, bead and bends.
TEST(Bracket, WallsAreTwoMillimetresThick) {
  struct Wall {
    Eigen::Vector3f corner, side_a, side_b, inwards;
  };
  const Wall walls[] = {
      {{-5, -38, 8}, {0, 76, 0}, {0, 0, 14}, {1, 0, 0}},     // back flange, below the window
      {{8, -38, -5}, {0, 18, 0}, {0, 0, 0}, {0, 0, 1}},      // line beside the first bend, below the hole
      {{30, -38, -5}, {60, 0, 0}, {0, 30, 0}, {0, 0, 1}},    // base, right of the bead
      {{30, 8, -5}, {60, 0, 0}, {0, 30, 0}, {0, 0, 1}},      // base, left of the bead
      {{125, -18, 8}, {0, 36, 0}, {0, 0, 24}, {-1, 0, 0}}};  // front flange, between its holes
  const RayScene scene(good());
  std::mt19937_64 random(3);
  std::uniform_real_distribution<float> uniform;
  for (const Wall& wall : walls) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3f from = wall.corner + uniform(random) * wall.side_a + uniform(random) * wall.side_b;
      const auto enter = scene.cast(from, wall.inwards);
      ASSERT_TRUE(enter) << from.transpose();
      EXPECT_LT(good().normal(enter->triangle).dot(wall.inwards), -0.999);
      const auto leave = scene.cast(from + (enter->distance + 0.5f) * wall.inwards, wall.inwards);
      ASSERT_TRUE(leave);
      EXPECT_NEAR(leave->distance + 0.5, 2, 1e-3) << from.transpose();
      EXPECT_GT(good().normal(leave->triangle).dot(wall.inwards), 0.999);
    }
  }
}

TEST(Bracket, HasSevenHolesOfTheRightSize) {
  const RayScene scene(good());
  struct Hole {
    Eigen::Vector3f centre, axis, across;
    float radius;
  };
  const Eigen::Vector3f x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  for (const Hole& h : {Hole{{1, -14, 36}, x, y, 10}, Hole{{20, -27, 1}, z, y, 4}, Hole{{20, 27, 1}, z, y, 4},
                        Hole{{100, -27, 1}, z, y, 4}, Hole{{100, 27, 1}, z, y, 4}, Hole{{119, -24, 20}, x, y, 3},
                        Hole{{119, 24, 20}, x, y, 3}}) {
    EXPECT_FALSE(scene.occluded(h.centre - 4 * h.axis, h.centre + 4 * h.axis)) << h.centre.transpose();
    const auto rim = scene.cast(h.centre, h.across);
    ASSERT_TRUE(rim);
    EXPECT_NEAR(rim->distance, h.radius, 0.06) << h.centre.transpose();  // a polygon is inside its circle
  }
}

/// Each truth's box, grown by 2 mm.
std::vector<Eigen::AlignedBox3d> places_of(const std::vector<DefectTruth>& truths, double threshold_mm) {
  (void)threshold_mm;
  std::vector<Eigen::AlignedBox3d> boxes;
  for (const DefectTruth& t : truths) {
    const Eigen::Vector3d half = 0.5 * t.extent_mm + Eigen::Vector3d::Constant(2);
    boxes.emplace_back(t.centre_mm - half, t.centre_mm + half);
  }
  return boxes;
}
