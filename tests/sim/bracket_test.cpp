#include "gantry/sim/bracket.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/mesh_topology.h"
#include "gantry/geometry/ray_scene.h"
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
      {{8, -20, -5}, {20, 0, 0}, {0, 40, 0}, {0, 0, 1}},     // base, before the bead and between the holes
      {{30, -38, -5}, {60, 0, 0}, {0, 30, 0}, {0, 0, 1}},    // base, right of the bead
      {{30, 8, -5}, {60, 0, 0}, {0, 30, 0}, {0, 0, 1}},      // base, left of the bead
      {{125, -18, 8}, {0, 36, 0}, {0, 0, 24}, {-1, 0, 0}}};  // front flange, between its holes
  const RayScene scene(good());
  std::mt19937_64 random(3);
  std::uniform_real_distribution<float> uniform;
  for (const Wall& wall : walls) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3f from =
          wall.corner + uniform(random) * wall.side_a + uniform(random) * wall.side_b;
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
                        Hole{{100, -27, 1}, z, y, 4}, Hole{{100, 27, 1}, z, y, 4},
                        Hole{{119, -24, 20}, x, y, 3}, Hole{{119, 24, 20}, x, y, 3}}) {
    EXPECT_FALSE(scene.occluded(h.centre - 4 * h.axis, h.centre + 4 * h.axis)) << h.centre.transpose();
    const auto rim = scene.cast(h.centre, h.across);
    ASSERT_TRUE(rim);
    EXPECT_NEAR(rim->distance, h.radius, 0.06) << h.centre.transpose();  // a polygon is inside its circle
  }
}

TEST(Bracket, DefectsDeviateFromTheGoodPartOnlyWhereTheTruthSaysSo) {
  for (const double threshold_mm : {0.2, 0.01}) {
    std::vector<Eigen::AlignedBox3d> places;
    for (const DefectTruth& truth : bracket_truth(seeded_defects(), threshold_mm)) {
      const Eigen::Vector3d half = 0.5 * truth.extent_mm + Eigen::Vector3d::Constant(2);
      places.emplace_back(truth.centre_mm - half, truth.centre_mm + half);
    }
    ASSERT_EQ(places.size(), 4u);
    std::vector<int> deviating(places.size(), 0);
    for (const Eigen::Vector3f& vertex : defective().vertices) {
      const auto deviation = distance_to_good()(vertex, 10);
      ASSERT_TRUE(deviation);
      if (std::abs(deviation->distance) < threshold_mm + 0.005) continue;
      bool explained = false;
      for (size_t k = 0; k < places.size(); ++k) {
        if (!places[k].contains(vertex.cast<double>())) continue;
        explained = true;
        ++deviating[k];
      }
      EXPECT_TRUE(explained) << vertex.transpose() << " deviates by " << deviation->distance;
    }
    for (size_t k = 0; k < places.size(); ++k) EXPECT_GT(deviating[k], 10) << "defect " << k;
  }
}

struct SingleDefect {
  const char* kind;
  BracketDefects defects;
  double tolerance_mm;
};

/// Against the meshes, which know nothing of the formulas that bracket_truth() samples.
TEST(Bracket, TheDepthOfEachTruthIsTheLargestDeviationBetweenTheMeshes) {
  const SingleDefect cases[] = {{"dent", {.dent_depth_mm = 0.4}, 0.02},
                                {"dent", {.dent_depth_mm = 0.75}, 0.02},
                                {"missing_hole", {.missing_hole = true}, 0.05},
                                {"burr", {.burr_height_mm = 0.6}, 0.02},
                                {"bent_flange", {.flange_bend_rad = std::numbers::pi / 180}, 0.02},
                                {"bent_flange", {.flange_bend_rad = -0.03}, 0.02}};
  for (const SingleDefect& c : cases) {
    const std::vector<DefectTruth> truths = bracket_truth(c.defects, 0.2);
    ASSERT_EQ(truths.size(), 1u) << c.kind;
    EXPECT_EQ(truths[0].kind, c.kind);
    double deepest = 0;
    Eigen::Vector3f where = Eigen::Vector3f::Zero();
    for (const Eigen::Vector3f& vertex : make_bracket(c.defects).vertices) {
      const double deviation = std::abs(distance_to_good()(vertex, 10)->distance);
      if (deviation <= deepest) continue;
      deepest = deviation;
      where = vertex;
    }
    EXPECT_NEAR(truths[0].depth_mm, deepest, c.tolerance_mm) << c.kind << " at " << where.transpose();
    const Eigen::Vector3d half = 0.5 * truths[0].extent_mm + Eigen::Vector3d::Constant(2);
    EXPECT_TRUE((where.cast<double>() - truths[0].centre_mm).cwiseAbs().cwiseQuotient(half).maxCoeff() < 1)
        << c.kind << " at " << where.transpose();
  }
  EXPECT_TRUE(bracket_truth({}, 0.01).empty());
  EXPECT_TRUE(bracket_truth({.dent_depth_mm = 0.1}, 0.2).empty()) << "below the threshold";
}

TEST(Bracket, TheAreaOfTheTruthIsThatOfTheFoldedSurface) {
  // A dent of depth d deviates by more than t where cos^2(pi r / 2R) > t/d: a disc on both faces.
  const double radius = 4 * 2 / std::numbers::pi * std::acos(std::sqrt(0.2 / 0.4));
  const DefectTruth dent = bracket_truth({.dent_depth_mm = 0.4}, 0.2).at(0);
  EXPECT_NEAR(dent.area_mm2, 2 * std::numbers::pi * radius * radius, 0.5);
  EXPECT_NEAR(dent.extent_mm.y(), 2 * radius, 0.11);
  EXPECT_NEAR(dent.extent_mm.z(), 2 * radius, 0.11);
}

TEST(Holder, IsTwoWatertightShellsThatTouchNothing) {
  const TriangleMesh holder = make_holder();
  const MeshTopology topology = analyse_topology(holder);
  EXPECT_TRUE(topology.watertight()) << topology.text();
  EXPECT_EQ(topology.degenerate_triangles, 0u);
  // Vertices minus edges plus faces is 2 for each sphere-like shell; three half-edges make a triangle.
  const auto euler = static_cast<int>(holder.vertices.size()) - static_cast<int>(holder.triangles.size()) / 2;
  EXPECT_EQ(euler, 4);
  const double post = std::numbers::pi * (50 * 50 * 10 + 11 * 11 * 49.98),
               screw = std::numbers::pi * 25 * 5.98;
  EXPECT_NEAR(holder.volume() / (post + screw), 1, 0.01) << "triangles face outwards";
  for (const Eigen::Vector3f& vertex : holder.vertices) {
    const auto distance = distance_to_good()(vertex, 200);
    ASSERT_TRUE(distance);
    EXPECT_GT(distance->distance, 0.01) << vertex.transpose() << " is inside the part";
  }
}

void expect_equal(const TriangleMesh& file, const TriangleMesh& made) {
  ASSERT_EQ(file.triangles.size(), made.triangles.size());
  float largest = 0;
  for (size_t t = 0; t < made.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k)
      largest = std::max(
          largest,
          (file.vertices[file.triangles[t][k]] - made.vertices[made.triangles[t][k]]).cwiseAbs().maxCoeff());
  EXPECT_LE(largest, 1e-5f);
}

/// Mend a difference by: gantry-parts --out examples/parts
TEST(ShippedParts, AreWhatTheGeneratorMakesNow) {
  expect_equal(read_mesh(kParts / "bracket.stl"), good());
  expect_equal(read_mesh(kParts / "bracket_defective.stl"), defective());
  expect_equal(read_mesh(kParts / "holder.stl"), make_holder());
}

TEST(ShippedParts, TheTruthFileIsWhatTheGeneratorMakesNow) {
  const nlohmann::json file = nlohmann::json::parse(std::ifstream(kParts / "bracket_defective.truth.json"));
  EXPECT_EQ(file.at("reference"), "bracket.stl");
  EXPECT_EQ(file.at("unit"), "mm");
  const std::vector<DefectTruth> made = bracket_truth(seeded_defects(), file.at("threshold_mm"));
  ASSERT_EQ(file.at("defects").size(), made.size());
  for (size_t i = 0; i < made.size(); ++i) {
    const nlohmann::json& entry = file.at("defects")[i];
    EXPECT_EQ(entry.at("kind"), made[i].kind);
    EXPECT_NEAR(entry.at("depth_mm"), made[i].depth_mm, 1e-5);
    EXPECT_NEAR(entry.at("area_mm2"), made[i].area_mm2, 1e-5);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(entry.at("centre_mm")[k], made[i].centre_mm[k], 1e-5);
      EXPECT_NEAR(entry.at("extent_mm")[k], made[i].extent_mm[k], 1e-5);
    }
  }
}

}  // namespace
}  // namespace gantry
