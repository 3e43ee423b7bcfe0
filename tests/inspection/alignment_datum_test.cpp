#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "foundation/expect_input_error.h"
#include "gantry/inspection/datums.h"
#include "gantry/sim/bracket.h"
#include "inspection/alignment_samples.h"

namespace gantry {
namespace {

const Eigen::Vector3f kLow(0, 0, 0), kHigh(80, 60, 40);

const SignedDistance& block() {
  static const SignedDistance model(box_mesh(kLow, kHigh));
  return model;
}

Datum plane(const std::string& name, const Eigen::Vector3d& position, double radius_mm = 18) {
  Datum datum;
  datum.name = name;
  datum.position_mm = position;
  datum.radius_mm = radius_mm;
  return datum;
}

DatumSet three_planes() {
  return {"block", {plane("A", {40, 30, 0}, 25), plane("B", {40, 0, 20}), plane("C", {0, 30, 20})}};
}

Pose offset() {
  return turn_about({40, 30, 20}, {0.3, -0.2, 0.25}, {0.4, -0.3, 0.5});
}

AlignmentResult aligned(const PointCloud& cloud, const SignedDistance& model, const DatumSet& set) {
  return align_to_datums(cloud, model, set, align_to_model(cloud, model, {}), {});
}

TEST(DatumAlignment, ThreePlanesFixThreeTwoAndOne) {
  const AlignmentResult result =
      aligned(moved(mesh_points(block().mesh(), 40000, 0.02f), offset()), block(), three_planes());
  EXPECT_TRUE(result.converged);
  ASSERT_EQ(result.datums.size(), 3u);
  EXPECT_EQ(result.datums[0].fixes, 3);
  EXPECT_EQ(result.datums[1].fixes, 2);
  EXPECT_EQ(result.datums[2].fixes, 1);
  EXPECT_NEAR(result.datums[0].rms_mm, 0.02, 0.004);
  EXPECT_LT(point_sigma_mm(result.covariance, {40, 30, 20}), 0.005);
  EXPECT_LT(
      (result.cad_from_cloud * offset() * Eigen::Vector3d(40, 30, 20) - Eigen::Vector3d(40, 30, 20)).norm(),
      0.008);
}

TEST(DatumAlignment, EarlierDatumsAreMetWhateverLaterOnesSay) {
  // The side y = 0 leans by 0.01, the side x = 0 lies 0.5 mm in and is turned by 0.02.
  PointCloud cloud = mesh_points(block().mesh(), 60000, 0.005f);
  for (size_t i = 0; i < cloud.size(); ++i) {
    Eigen::Vector3f& p = cloud.points[i];
    if (cloud.normals[i].y() < -0.5f) p.y() += 0.01f * p.z();
    if (cloud.normals[i].x() < -0.5f) p.x() += 0.5f + 0.02f * (p.y() - 30);
  }
  const AlignmentResult result = aligned(moved(cloud, offset()), block(), three_planes());
  const Pose found = result.cad_from_cloud * offset();  // cad from the cloud as it was made
  const Eigen::Vector3d a = found.linear().col(2);
  EXPECT_LT(std::hypot(a.x(), a.y()), 2e-4) << "A fixes tilt alone";
  EXPECT_NEAR((found * Eigen::Vector3d(40, 30, 0)).z(), 0, 0.003);
  EXPECT_NEAR(found.linear()(1, 0), 0, 3e-4) << "B fixes the turn, C does not";
  EXPECT_NEAR((found * Eigen::Vector3d(40, 0.2, 20)).y(), 0, 0.005);
  EXPECT_NEAR((found * Eigen::Vector3d(0.5, 30, 20)).x(), 0, 0.005);
  EXPECT_NEAR(result.datums[1].tilt_deg, 0.01 * 180 / std::numbers::pi, 0.03);
  EXPECT_NEAR(result.datums[2].tilt_deg, 0.02 * 180 / std::numbers::pi, 0.03);
  EXPECT_NEAR(result.datums[0].offset_mm, 0, 1e-5);
}

TEST(DatumAlignment, CovarianceCoversTheTruth) {
  constexpr int kRuns = 200;
  double within = 0;
  for (uint32_t seed = 1; seed <= kRuns; ++seed) {
    const PointCloud cloud = moved(mesh_points(block().mesh(), 4000, 0.02f, seed), offset());
    AlignmentResult start;
    start.cad_from_cloud = turn_about({40, 30, 20}, {0.05, 0.05, -0.05}, {0.1, 0, -0.1}) * offset().inverse();
    const AlignmentResult result = align_to_datums(cloud, block(), three_planes(), start, {});
    within += chi_square(result, offset()) <= chi_square_95(6) ? 1.0 / kRuns : 0;
  }
  std::printf("within 95 %%: %.3f\n", within);
  EXPECT_GT(within, 0.90);
  EXPECT_LT(within, 0.995);
}

TEST(DatumAlignment, PlaneHoleAndPointLocateTheBracket) {
  const SignedDistance model(make_bracket());
  DatumSet set{"bracket",
               {plane("A", {60, 21, 0}), plane("hole", {20, -27, 1}, 6), plane("tip", {0, 25, 30}, 5)}};
  set.datums[0].radius_mm = 13;
  set.datums[0].normal = Eigen::Vector3d(0, 0, -1);
  set.datums[1].kind = DatumKind::kCylinder;
  set.datums[2].kind = DatumKind::kPoint;
  const Pose pose = turn_about({60, 0, 20}, {0.3, -0.2, 0.25}, {0.4, -0.3, 0.5});
  const AlignmentResult result = aligned(moved(mesh_points(model.mesh(), 120000, 0.02f), pose), model, set);
  ASSERT_EQ(result.datums.size(), 3u);
  EXPECT_EQ(result.datums[0].fixes, 3);
  EXPECT_EQ(result.datums[1].fixes, 2);
  EXPECT_EQ(result.datums[2].fixes, 1);
  EXPECT_LT((result.cad_from_cloud * pose * Eigen::Vector3d(20, -27, 0) - Eigen::Vector3d(20, -27, 0)).norm(),
            0.01);
  EXPECT_LT(chi_square(result, pose), 22.5) << "99.9 % of chi-square with six freedoms";
}

TEST(DatumAlignment, WhatIsLeftOpenIsRefusedByName) {
  const PointCloud cloud = mesh_points(block().mesh(), 20000, 0.02f);
  DatumSet set = three_planes();
  set.datums.pop_back();
  expect_input_error([&] { aligned(cloud, block(), set); },
                     {"block", "A, B", "leave open", "sliding along x"});
  set = three_planes();
  set.datums[1] = plane("B", {30, 30, 40});
  expect_input_error([&] { aligned(cloud, block(), set); }, {"'B'", "fixes nothing"});
  set = {"block", {plane("A", {40, 30, 0})}};
  expect_input_error([&] { aligned(cloud, block(), set); },
                     {"sliding along x", "sliding along y", "turning about z"});
}

TEST(DatumAlignment, WhatIsNotThereIsRefused) {
  const PointCloud cloud = mesh_points(block().mesh(), 20000, 0.02f);
  DatumSet set = three_planes();
  set.datums[2].position_mm.x() = -50;
  expect_input_error([&] { aligned(cloud, block(), set); }, {"'C'", "no CAD surface"});
  set = three_planes();
  set.datums[2].kind = DatumKind::kCylinder;
  expect_input_error([&] { aligned(cloud, block(), set); }, {"'C'", "no cylinder"});
  PointCloud blind;
  for (size_t i = 0; i < cloud.size(); ++i)
    if (cloud.normals[i].y() > -0.5f) add_point(blind, cloud.points[i], cloud.normals[i], 0.02f);
  expect_input_error([&] { aligned(blind, block(), three_planes()); }, {"'B'", "points"});
}

class DatumsFile : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& text) {
    const auto path = std::filesystem::path(::testing::TempDir()) / "gantry_datums_test.yaml";
    std::ofstream(path) << text;
    return path;
  }
};

TEST_F(DatumsFile, TheExampleIsRead) {
  const DatumSet set = read_datums(std::filesystem::path(GANTRY_SOURCE_DIR) / "examples/datums/bracket.yaml");
  ASSERT_EQ(set.datums.size(), 3u);
  EXPECT_EQ(set.datums[0].name, "A");
  EXPECT_EQ(set.datums[0].kind, DatumKind::kPlane);
  ASSERT_TRUE(set.datums[0].box_mm);
  EXPECT_EQ(*set.datums[0].box_mm, Eigen::Vector3d(90, 26, 3));
  EXPECT_EQ(set.datums[2].kind, DatumKind::kCylinder);
  EXPECT_EQ(set.datums[2].radius_mm, 6);
}

TEST_F(DatumsFile, MistakesNameLineAndKey) {
  const std::string head = "datums:\n  - name: A\n    feature: plane\n";
  const auto refused = [&](const std::string& text, const std::vector<std::string>& parts) {
    expect_input_error([&] { read_datums(write(text)); }, parts);
  };
  refused("name: x\n", {"missing key 'datums'"});
  refused(head + "    position_mm: [0, 0, 0]\n", {":2:", "radius_mm"});
  refused(head + "    position_mm: [0, 0]\n    radius_mm: 3\n", {":4:", "position_mm"});
  refused(head + "    position_mm: [0, 0, 0]\n    radius_mm: -3\n", {":5:", "radius_mm"});
  refused(head + "    position_mm: [0, 0, 0]\n    radius_mm: 3\n    box_mm: [1, 1, 1]\n", {":6:", "box_mm"});
  refused(head + "    position_mm: [0, 0, 0]\n    box_mm: [1, 0, 1]\n", {":5:", "box_mm"});
  refused(head + "    position_mm: [0, 0, 0]\n    radius_mm: 3\n    normal: [0, 0, 0]\n", {":6:", "normal"});
  refused(head + "    position_mm: [0, 0, 0]\n    radius_mm: 3\n    colour: red\n", {":6:", "colour"});
  refused("datums:\n  - name: A\n    feature: sphere\n", {":3:", "feature", "plane, cylinder, point"});
  const std::string whole = "    position_mm: [0, 0, 0]\n    radius_mm: 3\n";
  refused(head + whole + "  - name: A\n    feature: plane\n" + whole, {":6:", "name"});
}

}  // namespace
}  // namespace gantry
