#include "gantry/inspection/defect_class.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "gantry/inspection/inspection.h"
#include "gantry/sim/bracket.h"
#include "inspection/samples.h"

namespace gantry {
namespace {

/// A sheet of 60 x 40 x 2 mm; its top lies in z = 0.
const Eigen::Vector3f kLow(-30, -20, -2), kHigh(30, 20, 0);

const SignedDistance& sheet() {
  static const SignedDistance distance(box_mesh(kLow, kHigh));
  return distance;
}

PointCloud sheet_points() {
  return box_points(kLow, kHigh, 0.4f, 0.02f);
}

InspectionOptions as_it_stands(double tolerance_mm = 0.2) {
  InspectionOptions options;
  options.tolerance_mm = tolerance_mm;
  options.align = false;
  options.symmetry_tolerance_mm = 0;
  return options;
}

float bump(const Eigen::Vector3f& p, float x, float y, float radius) {
  const float r = std::hypot(p.x() - x, p.y() - y) / radius;
  return r < 1 ? 0.5f * (1 + std::cos(std::numbers::pi_v<float> * r)) : 0.0f;
}

/// Points of the faces that look up (or down as well) displaced by a height over the sheet.
PointCloud displaced(PointCloud cloud, const std::function<float(const Eigen::Vector3f&)>& height,
                     bool both) {
  for (size_t i = 0; i < cloud.size(); ++i)
    if (cloud.normals[i].z() > 0.5f || (both && cloud.normals[i].z() < -0.5f))
      cloud.points[i].z() += height(cloud.points[i]);
  return cloud;
}

const Defect& only_defect(const InspectionResult& result) {
  EXPECT_EQ(result.defects.size(), 1u);
  static const Defect kNone;
  return result.defects.empty() ? kNone : result.defects[0];
}

/// A disc of 40 x 5 mm, with or without a boss on it, 12 mm wide and 4 mm high.
TriangleMesh disc(bool boss) {
  std::vector<Eigen::Vector2d> profile = {{0, 0}, {20, 0}, {20, 5}};
  if (boss) profile.insert(profile.end(), {{6, 5}, {6, 9}, {0, 9}});
  if (!boss) profile.emplace_back(0, 5);
  constexpr int kSegments = 96;
  TriangleMesh mesh;
  for (size_t i = 0; i + 1 < profile.size(); ++i)
    for (int s = 0; s < kSegments; ++s) {
      const auto at = [&](const Eigen::Vector2d& p, int k) {
        const double a = 2 * std::numbers::pi * (k % kSegments) / kSegments;
        mesh.vertices.push_back(
            Eigen::Vector3d(p.x() * std::cos(a), p.x() * std::sin(a), p.y()).cast<float>());
        return static_cast<int>(mesh.vertices.size()) - 1;
      };
      const int a = at(profile[i], s), b = at(profile[i], s + 1), c = at(profile[i + 1], s + 1),
                d = at(profile[i + 1], s);
      if (profile[i].x() > 0) mesh.triangles.emplace_back(a, b, c);
      if (profile[i + 1].x() > 0) mesh.triangles.emplace_back(a, c, d);
    }
  return mesh;
}

TEST(DefectClass, WhatTheDemoPartWasGivenIsTold) {
  const PointCloud cloud = mesh_points(make_bracket(seeded_defects()), 250000, 0.02f);
  const InspectionResult result = inspect(cloud, SignedDistance(make_bracket()), as_it_stands());
  const auto near = [&](const Eigen::Vector3d& place) -> const Defect& {
    const auto found =
        std::min_element(result.defects.begin(), result.defects.end(), [&](const auto& a, const auto& b) {
          return (a.centre_mm - place).norm() < (b.centre_mm - place).norm();
        });
    return *found;
  };
  ASSERT_EQ(result.defects.size(), 4u);
  const Defect& hole = near({100, 27, 1});
  EXPECT_EQ(hole.kind, DefectClass::kMissingFeature) << hole.words;
  EXPECT_EQ(hole.face_words, "hole of 8.0 mm along z at x 100.0, y 27.0");
  EXPECT_NEAR(hole.extra_mm3, std::numbers::pi * 16 * 2, 2);
  const Defect& dent = near({1, 22, 30});
  EXPECT_EQ(dent.kind, DefectClass::kPartDefect) << dent.words;
  EXPECT_EQ(dent.words, "dent or bulge through the wall");
  EXPECT_GT(dent.extra_mm3, 2);
  EXPECT_NEAR(dent.extra_mm3, dent.missing_mm3, 1);
  const Defect& burr = near({60, -39, 2.4});
  EXPECT_EQ(burr.kind, DefectClass::kExtraMaterial) << burr.words;
  EXPECT_NE(burr.face_words.find("+z, through z = 2.0"), std::string::npos) << burr.face_words;
  const Defect& flange = near({119, 0, 26});
  EXPECT_EQ(flange.kind, DefectClass::kPartDefect) << flange.words;
  EXPECT_EQ(flange.words, "bent or displaced, both sides alike");
}

TEST(DefectClass, OneSideOfASheetAloneIsMaterialAddedOrTaken) {
  for (const float height : {0.6f, -0.6f}) {
    const InspectionResult result =
        inspect(displaced(
                    sheet_points(), [&](const auto& p) { return height * bump(p, 8, -5, 5); }, false),
                sheet(), as_it_stands());
    const Defect& defect = only_defect(result);
    EXPECT_EQ(defect.kind, height > 0 ? DefectClass::kExtraMaterial : DefectClass::kMissingMaterial)
        << defect.words;
    EXPECT_EQ(defect.face_words, "plane, normal +z, through z = 0.0 mm");
    // Of the cone-like bump above the height at which it leaves the tolerance.
    double volume = 0;
    for (float x = -5; x < 5; x += 0.05f)
      for (float y = -5; y < 5; y += 0.05f)
        if (const float h = 0.6f * bump({x, y, 0}, 0, 0, 5); h > 0.2f) volume += 0.05 * 0.05 * h;
    EXPECT_NEAR(height > 0 ? defect.extra_mm3 : defect.missing_mm3, volume, 0.12 * volume);
    EXPECT_EQ(height > 0 ? defect.missing_mm3 : defect.extra_mm3, 0);
    EXPECT_NEAR(defect.signed_mean_mm, std::copysign(defect.mean_mm, height), 1e-6);
    EXPECT_GE(defect.mean_uncertainty_mm, 0.04);  // twice what neighbours share
  }
}

TEST(DefectClass, ADentThroughTheSheetIsForm) {
  const InspectionResult result =
      inspect(displaced(
                  sheet_points(), [](const auto& p) { return -0.6f * bump(p, 8, -5, 5); }, true),
              sheet(), as_it_stands());
  const Defect& defect = only_defect(result);
  EXPECT_EQ(defect.kind, DefectClass::kPartDefect) << defect.words;
  EXPECT_EQ(defect.words, "dent or bulge through the wall");
}

TEST(DefectClass, OfASolidADentIsFormAndSpatterIsMaterial) {
  const SignedDistance block(box_mesh({-30, -20, -40}, {30, 20, 0}));
  const PointCloud points = box_points({-30, -20, -40}, {30, 20, 0}, 0.4f, 0.02f);
  const auto kind = [&](float height, float radius) {
    const InspectionResult result =
        inspect(displaced(
                    points, [&](const auto& p) { return height * bump(p, 8, -5, radius); }, false),
                block, as_it_stands());
    return only_defect(result).kind;
  };
  EXPECT_EQ(kind(-0.6f, 6), DefectClass::kPartDefect);
  EXPECT_EQ(kind(0.9f, 3), DefectClass::kExtraMaterial);
  EXPECT_EQ(kind(0.4f, 14), DefectClass::kPartDefect);  // a gentle bulge
}

TEST(DefectClass, ABrokenEdgeIsMissingMaterial) {
  const SignedDistance block(box_mesh({-30, -20, -40}, {30, 20, 0}));
  PointCloud cloud = box_points({-30, -20, -40}, {30, 20, 0}, 0.4f, 0.02f);
  // Cut off by a plane at 45 degrees along 12 mm of an edge; its points stand in for those that are gone.
  const Eigen::Vector3f normal = Eigen::Vector3f(0, 1, 1).normalized();
  for (size_t i = 0; i < cloud.size(); ++i) {
    Eigen::Vector3f& p = cloud.points[i];
    const float over = normal.dot(p - Eigen::Vector3f(0, 20, -1.5f));
    if (std::abs(p.x()) > 6 || over < 0) continue;
    p -= over * normal;
    cloud.normals[i] = normal;
  }
  const InspectionResult result = inspect(cloud, block, as_it_stands());
  EXPECT_EQ(only_defect(result).kind, DefectClass::kMissingMaterial) << only_defect(result).words;
}

TEST(DefectClass, ABossThatIsNotThereIsAMissingFeature) {
  const SignedDistance cad(disc(true));
  const InspectionResult result = inspect(mesh_points(disc(false), 60000, 0.02f), cad, as_it_stands());
  const Defect& defect = only_defect(result);
  EXPECT_EQ(defect.kind, DefectClass::kMissingFeature) << defect.words;
  EXPECT_EQ(defect.words, "not there: material is missing in its place");
  EXPECT_LT(defect.peak_mm, -3);
  EXPECT_TRUE(inspect(mesh_points(disc(true), 60000, 0.02f), cad, as_it_stands()).defects.empty());
}

TEST(DefectClass, SurfaceWithoutDataIsListedWithItsFaceAndPlace) {
  PointCloud seen;
  const PointCloud all = sheet_points();
  for (size_t i = 0; i < all.size(); ++i) {
    const Eigen::Vector3f& p = all.points[i];
    if (all.normals[i].z() > 0.5f && std::abs(p.x() - 10) < 6 && std::abs(p.y()) < 5) continue;
    add_point(seen, p, all.normals[i], all.sigma_mm[i]);
  }
  InspectionOptions options = as_it_stands();
  const InspectionResult result = inspect(seen, sheet(), options);
  ASSERT_EQ(result.unseen.size(), 1u);
  const UnjudgedRegion& gap = result.unseen[0];
  EXPECT_EQ(gap.kind, DefectClass::kNoData);
  // A seen point counts for what lies within 1 mm.
  EXPECT_NEAR(gap.area_mm2, 10.4 * 8.4, 8);  // and the next row of points is up to 0.4 mm further
  EXPECT_NEAR(result.unseen_mm2, gap.area_mm2, 10);
  EXPECT_LT((gap.centre_mm - Eigen::Vector3d(10, 0, 0)).norm(), 0.5);
  EXPECT_NEAR(gap.extent_mm.x(), 10, 1);
  EXPECT_NEAR(gap.extent_mm.y(), 8, 1);
  EXPECT_GT(gap.normal.z(), 0.99);
  EXPECT_EQ(gap.face_words, "plane, normal +z, through z = 0.0 mm");
  EXPECT_NEAR(gap.face_share, 80.0 / 2400, 0.01);
  EXPECT_FALSE(gap.behind_fixture);
  EXPECT_EQ(result.verdict, Verdict::kPass);

  options.min_unseen_area_mm2 = 200;
  const InspectionResult coarse = inspect(seen, sheet(), options);
  EXPECT_TRUE(coarse.unseen.empty());
  EXPECT_NEAR(coarse.unseen_mm2, result.unseen_mm2, 1e-9);
  options.min_unseen_area_mm2 = -1;
  expect_input_error([&] { inspect(seen, sheet(), options); }, {"without data"});
}

class LearnedFixture : public testing::Test {
 protected:
  // A post below the sheet; what it carries of the underside is hidden.
  LearnedFixture() {
    const PointCloud all = sheet_points();
    for (size_t i = 0; i < all.size(); ++i)
      if (all.normals[i].z() > -0.5f || all.points[i].head<2>().cwiseAbs().maxCoeff() > 5)
        add_point(seen_, all.points[i], all.normals[i], all.sigma_mm[i]);
    part_ = seen_.size();
    const PointCloud post = box_points({-5, -5, -12}, {5, 5, -2.02f}, 0.4f, 0.02f);
    for (size_t i = 0; i < post.size(); ++i)
      if (post.normals[i].z() < 0.5f) add_point(seen_, post.points[i], post.normals[i], post.sigma_mm[i]);
    // The empty post: other noise, other places, its top seen too.
    empty_ = box_points({-5.1f, -5.05f, -12}, {5, 5, -2.02f}, 0.5f, 0.02f, 7);
  }

  PointCloud seen_, empty_;
  size_t part_ = 0;
};

TEST_F(LearnedFixture, ServesAsItsMeshDoes) {
  InspectionOptions options;
  options.tolerance_mm = 0.15;
  EXPECT_EQ(inspect(seen_, sheet(), options).verdict, Verdict::kFail);
  options.fixture = box_mesh({-5, -5, -12}, {5, 5, -2.02f});
  const InspectionResult by_mesh = inspect(seen_, sheet(), options);
  options.fixture.reset();
  for (const bool normals : {true, false}) {
    options.fixture_scan = empty_;
    if (!normals) options.fixture_scan->normals.clear();
    const InspectionResult result = inspect(seen_, sheet(), options);
    EXPECT_EQ(result.verdict, Verdict::kPass) << result.reason;
    size_t other = 0;
    for (size_t i = 0; i < seen_.size(); ++i) {
      other +=
          (result.point_class[i] == PointClass::kFixture) != (by_mesh.point_class[i] == PointClass::kFixture);
      if (i >= part_) {
        EXPECT_EQ(result.point_class[i], PointClass::kFixture) << seen_.points[i].transpose();
      }
    }
    EXPECT_LT(static_cast<double>(other), 0.01 * static_cast<double>(seen_.size()));
    // Listed: the post, and what it hides of the sheet.
    ASSERT_EQ(result.fixture_regions.size(), 1u);
    EXPECT_EQ(result.fixture_regions[0].kind, DefectClass::kFixture);
    EXPECT_NEAR(result.fixture_regions[0].area_mm2, 4 * 10 * 10 + 10 * 10, 100);
    EXPECT_LT(result.fixture_regions[0].centre_mm.head<2>().norm(), 1);
    ASSERT_EQ(result.unseen.size(), 1u);
    EXPECT_TRUE(result.unseen[0].behind_fixture);
    EXPECT_LT(result.unseen[0].normal.z(), -0.99);
  }
}

TEST_F(LearnedFixture, StrayPointsOfItsScanHideNothing) {
  InspectionOptions options = as_it_stands();
  const PointCloud bulging = displaced(
      sheet_points(), [](const auto& p) { return 0.6f * bump(p, 8, -5, 5); }, false);
  options.fixture_scan = empty_;
  const InspectionResult without = inspect(bulging, sheet(), options);
  ASSERT_EQ(without.defects.size(), 1u);
  // All over the bulge, but each by itself.
  for (int i = -2; i <= 2; ++i)
    for (int j = -2; j <= 2; ++j)
      add_point(*options.fixture_scan, {8 + 2.5f * i, -5 + 2.5f * j, 0.4f}, Eigen::Vector3f::UnitZ(), 0.02f);
  const InspectionResult with = inspect(bulging, sheet(), options);
  ASSERT_EQ(with.defects.size(), 1u);
  EXPECT_EQ(with.defects[0].points, without.defects[0].points);
}

TEST_F(LearnedFixture, AnEmptyScanIsRefused) {
  InspectionOptions options = as_it_stands();
  options.fixture_scan = PointCloud{};
  expect_input_error([&] { inspect(seen_, sheet(), options); }, {"holds no points"});
  options.fixture_scan->points = {{0, 0, 0}, {100, 0, 0}, {0, 100, 0}};
  expect_input_error([&] { inspect(seen_, sheet(), options); }, {"scattered"});
}

TEST(SurfaceStatistics, OfFacesAndRegionsTellWhatWasMeasured) {
  // The top is 0.05 mm too high; the underside was not seen for x < 0.
  PointCloud cloud;
  const PointCloud all = sheet_points();
  for (size_t i = 0; i < all.size(); ++i) {
    if (all.normals[i].z() < -0.5f && all.points[i].x() < 0) continue;
    const float up = all.normals[i].z() > 0.5f ? 0.05f : 0.0f;
    add_point(cloud, all.points[i] + Eigen::Vector3f(0, 0, up), all.normals[i], all.sigma_mm[i]);
  }
  const InspectionResult result = inspect(cloud, sheet(), as_it_stands());
  ASSERT_EQ(result.faces.size(), 6u);
  const auto face = [&](const std::string& words) {
    return *std::find_if(result.faces.begin(), result.faces.end(),
                         [&](const auto& s) { return s.words.find(words) != std::string::npos; });
  };
  const SurfaceStatistics top = face("+z"), bottom = face("-z");
  EXPECT_NEAR(top.mean_mm, 0.05, 0.002);
  EXPECT_LT(top.sigma_mm, 0.02);
  EXPECT_NEAR(top.area_mm2, 2400, 1e-6);
  EXPECT_GT(top.seen, 0.999);
  EXPECT_NEAR(bottom.mean_mm, 0, 0.002);
  EXPECT_NEAR(bottom.seen, 0.5 + 1.0 / 60, 0.01);
  EXPECT_GE(top.uncertainty_mm, 0.02);  // what neighbours share is not averaged away
  EXPECT_LE(top.min_mm, top.p05_mm);
  EXPECT_LE(top.p05_mm, top.p95_mm);
  size_t points = 0;
  for (const auto& s : result.faces) points += s.points;
  EXPECT_EQ(points, result.statistics.count);

  EXPECT_GE(result.regions.size(), 50u);
  EXPECT_LE(result.regions.size(), 100u);
  double area = 0;
  points = 0;
  for (const SurfaceStatistics& s : result.regions) {
    area += s.area_mm2;
    points += s.points;
    EXPECT_GT(s.area_mm2, 5200.0 / 72 / 4) << s.name;
    EXPECT_LT(s.area_mm2, 5200.0 / 72 * 2.5) << s.name;
    // The two sides of the sheet never share a tile.
    if (s.normal.z() > 0.9) {
      EXPECT_NEAR(s.mean_mm, 0.05, 0.02) << s.name;
    }
    if (s.normal.z() < -0.9 && s.points > 0) {
      EXPECT_NEAR(s.mean_mm, 0, 0.02) << s.name;
    }
  }
  EXPECT_NEAR(area, 5200, 1e-6);
  EXPECT_EQ(points, result.statistics.count);
  const InspectionResult again = inspect(sheet_points(), sheet(), as_it_stands());
  for (size_t r = 0; r < again.regions.size(); ++r) {
    EXPECT_EQ(again.regions[r].name, result.regions[r].name);
    EXPECT_EQ(again.regions[r].centre_mm, result.regions[r].centre_mm);
  }
}

}  // namespace
}  // namespace gantry
