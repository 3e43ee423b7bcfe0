#include "gantry/inspection/inspection.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "gantry/sim/bracket.h"
#include "inspection/samples.h"

namespace gantry {
namespace {

constexpr float kSpacingMm = 0.4f;

/// A sheet of 60 x 40 x 2 mm; its top lies in z = 0.
const Eigen::Vector3f kLow(-30, -20, -2), kHigh(30, 20, 0);

const SignedDistance& sheet() {
  static const SignedDistance distance(box_mesh(kLow, kHigh));
  return distance;
}

PointCloud sheet_points(float noise_mm, uint32_t seed = 1) {
  return box_points(kLow, kHigh, kSpacingMm, noise_mm, seed);
}

/// Moves points of the sheet's top by a height over (x, y).
PointCloud with_top(PointCloud cloud, const std::function<float(float x, float y)>& height) {
  for (size_t i = 0; i < cloud.size(); ++i)
    if (cloud.normals[i].z() > 0.5f) cloud.points[i].z() += height(cloud.points[i].x(), cloud.points[i].y());
  return cloud;
}

/// A smooth bump of 5 mm radius.
std::function<float(float, float)> bump(float x0, float y0, float height_mm) {
  return [=](float x, float y) {
    const float r = std::hypot(x - x0, y - y0) / 5;
    return r < 1 ? height_mm * 0.5f * (1 + std::cos(std::numbers::pi_v<float> * r)) : 0.0f;
  };
}

InspectionOptions as_it_stands(double tolerance_mm = 0.2) {
  InspectionOptions options;
  options.tolerance_mm = tolerance_mm;
  options.align = false;
  return options;
}

/// A sphere as rings of latitude; chords lie within a micrometre or two of it.
TriangleMesh sphere_mesh(float radius) {
  constexpr int kRings = 180, kSegments = 360;
  TriangleMesh mesh;
  mesh.vertices.emplace_back(0, 0, radius);
  for (int ring = 1; ring < kRings; ++ring)
    for (int s = 0; s < kSegments; ++s) {
      const double polar = std::numbers::pi * ring / kRings, azimuth = 2 * std::numbers::pi * s / kSegments;
      mesh.vertices.push_back((radius * Eigen::Vector3d(std::sin(polar) * std::cos(azimuth),
                                                        std::sin(polar) * std::sin(azimuth), std::cos(polar)))
                                  .cast<float>());
    }
  mesh.vertices.emplace_back(0, 0, -radius);
  const int last = static_cast<int>(mesh.vertices.size()) - 1;
  for (int s = 0; s < kSegments; ++s) {
    const int next = (s + 1) % kSegments;
    mesh.triangles.emplace_back(0, 1 + s, 1 + next);
    for (int ring = 0; ring + 2 < kRings; ++ring) {
      const int a = 1 + ring * kSegments + s, b = 1 + ring * kSegments + next;
      mesh.triangles.emplace_back(a, a + kSegments, b);
      mesh.triangles.emplace_back(b, a + kSegments, b + kSegments);
    }
    const int above = last - kSegments;
    mesh.triangles.emplace_back(above + s, last, above + next);
  }
  return mesh;
}

size_t judged(const InspectionResult& result) {
  return static_cast<size_t>(
      std::count(result.point_class.begin(), result.point_class.end(), PointClass::kJudged));
}

TEST(Inspection, NothingIsMeasuredToTheBorderOfAnOpenModel) {
  // Only the middle of the sheet's top is modelled; the cloud reaches beyond.
  const SignedDistance patch(
      TriangleMesh{{{-10, -10, 0}, {10, -10, 0}, {10, 10, 0}, {-10, 10, 0}}, {{0, 1, 2}, {0, 2, 3}}});
  const InspectionResult result = inspect(sheet_points(0.02f), patch, as_it_stands());
  EXPECT_TRUE(result.defects.empty());
  for (size_t i = 0; i < result.cloud.size(); ++i) {
    const Eigen::Vector3f& p = result.cloud.points[i];
    const float outside = std::max(std::abs(p.x()), std::abs(p.y())) - 10;
    if (outside > 0.01f) {
      ASSERT_NE(result.point_class[i], PointClass::kJudged) << p.transpose();
    }
    if (outside < -0.01f && p.z() > -0.2f) {
      ASSERT_EQ(result.point_class[i], PointClass::kJudged) << p.transpose();
    }
  }
}

TEST(Inspection, TooMuchMaterialIsPositiveAndMissingIsNegative) {
  for (const float height : {0.6f, -0.6f}) {
    const InspectionResult result =
        inspect(with_top(sheet_points(0.02f), bump(8, -5, height)), sheet(), as_it_stands());
    EXPECT_EQ(result.verdict, Verdict::kFail) << result.reason;
    ASSERT_EQ(result.defects.size(), 1u);
    const Defect& defect = result.defects[0];
    EXPECT_EQ(defect.id, 1);
    EXPECT_NEAR(defect.peak_mm, height, 0.04);
    EXPECT_TRUE(defect.certain);
    EXPECT_LT((defect.peak_at_mm - Eigen::Vector3d(8, -5, height)).norm(), 1.0);
    EXPECT_LT((defect.centre_mm.head<2>() - Eigen::Vector2d(8, -5)).norm(), 0.3);
    EXPECT_GT(defect.normal.z(), 0.99);
    // 0.6 / 2 (1 + cos(pi r / 5)) = 0.2 at r = 3.04 mm.
    EXPECT_NEAR(defect.area_mm2, std::numbers::pi * 3.04 * 3.04, 5);
    EXPECT_NEAR(defect.extent_mm.x(), 6.1, 0.6);
    EXPECT_NEAR(defect.extent_mm.y(), 6.1, 0.6);
    size_t marked = 0;
    for (size_t i = 0; i < result.defect_id.size(); ++i) {
      marked += result.defect_id[i] == 1;
      EXPECT_EQ(result.defect_id[i] == 1, std::abs(result.deviation_mm[i]) > 0.2);
    }
    EXPECT_EQ(marked, defect.points);
  }
}

TEST(Inspection, ABumpOnASphereIsFoundAfterAlignment) {
  constexpr float kRadius = 30, kBump = 0.5f, kBumpAngle = 0.2f;
  const TriangleMesh mesh = sphere_mesh(kRadius);
  PointCloud cloud = mesh_points(mesh, 60000, 0.02f);
  const Eigen::Vector3f direction = Eigen::Vector3f(1, 2, 3).normalized();
  for (auto& p : cloud.points) {
    const float angle = std::acos(std::clamp(p.normalized().dot(direction), -1.0f, 1.0f)) / kBumpAngle;
    if (angle < 1) p += p.normalized() * kBump * std::pow(1 - angle * angle, 2.0f);
    p.x() += 0.5f;
  }
  InspectionOptions options;
  options.tolerance_mm = 0.15;
  const InspectionResult result = inspect(cloud, SignedDistance(mesh), options);
  EXPECT_EQ(result.verdict, Verdict::kFail) << result.reason;
  ASSERT_EQ(result.defects.size(), 1u);
  EXPECT_NEAR(result.defects[0].peak_mm, kBump, 0.04);
  EXPECT_LT((result.defects[0].peak_at_mm - (kRadius * direction).cast<double>()).norm(), 1.5);
  EXPECT_GT(result.defects[0].normal.dot(direction.cast<double>()), 0.98);
}

TEST(Inspection, ACleanPartPassesWithinItsUncertainty) {
  for (uint32_t seed = 1; seed <= 5; ++seed) {
    InspectionOptions options;
    options.tolerance_mm = 0.15;
    const PointCloud cloud = sheet_points(0.04f, seed);
    const InspectionResult result = inspect(cloud, sheet(), options);
    EXPECT_EQ(result.verdict, Verdict::kPass) << "seed " << seed << ": " << result.reason;
    EXPECT_TRUE(result.defects.empty());
    EXPECT_GT(result.coverage, 0.98);
    EXPECT_GT(judged(result), cloud.size() * 9 / 10);
    size_t within = 0, count = 0;
    for (size_t i = 0; i < cloud.size(); ++i) {
      if (result.point_class[i] != PointClass::kJudged) {
        EXPECT_TRUE(std::isnan(result.deviation_mm[i]) && std::isnan(result.uncertainty_mm[i]));
        continue;
      }
      ++count;
      within += std::abs(result.deviation_mm[i]) <= 3 * result.uncertainty_mm[i];
    }
    EXPECT_GE(static_cast<double>(within), 0.99 * static_cast<double>(count));
    EXPECT_EQ(result.statistics.count, count);
    EXPECT_NEAR(result.statistics.mean, 0, 0.005);
    EXPECT_LT(result.statistics.sigma, 0.03);
    EXPECT_EQ(result.statistics.within_tolerance, 1);
  }
}

TEST(Inspection, StatisticsDescribeTheJudgedDeviations) {
  PointCloud cloud = sheet_points(0);
  for (auto& p : cloud.points) p.x() += 0.1f;
  const InspectionResult result = inspect(cloud, sheet(), as_it_stands());
  EXPECT_NEAR(result.statistics.max, 0.1, 1e-3);
  EXPECT_NEAR(result.statistics.min, -0.1, 1e-3);
  EXPECT_NEAR(result.statistics.p50, 0, 1e-3);
  EXPECT_NEAR(result.statistics.p05, 0, 1e-3);
  EXPECT_NEAR(std::pow(result.statistics.rms, 2),
              std::pow(result.statistics.sigma, 2) + std::pow(result.statistics.mean, 2), 1e-6);
}

TEST(Inspection, TheSensorsOwnErrorsAverageOverTheScansThatSawAPoint) {
  InspectionOptions options = as_it_stands();
  options.systematic_sigma_mm = 0.03;
  PointCloud cloud = sheet_points(0.01f);
  EXPECT_NEAR(inspect(cloud, sheet(), options).budget.sensor, 0.03, 1e-6);
  auto sources = std::make_shared<CloudSources>();
  sources->scans = {"a", "b", "c"};
  sources->first.push_back(0);
  for (size_t i = 0; i < cloud.size(); ++i) {
    for (uint16_t k = 0; k < 3; ++k) sources->shares.push_back({k, CloudSources::Share::kWhole / 3});
    sources->first.push_back(static_cast<uint32_t>(sources->shares.size()));
  }
  cloud.sources = sources;
  const InspectionResult result = inspect(cloud, sheet(), options);
  EXPECT_NEAR(result.budget.sensor, 0.03 / std::sqrt(3.0), 1e-6);
  EXPECT_FALSE(result.poses_known);
  EXPECT_EQ(result.budget.scan_poses, 0);
  auto placed = std::make_shared<CloudSources>(*sources);
  placed->pose_covariance = Eigen::MatrixXd::Zero(18, 18);
  for (int i = 0; i < 3; ++i)
    placed->pose_covariance.block<3, 3>(6 * i + 3, 6 * i + 3).diagonal().setConstant(9e-4);
  cloud.sources = placed;
  const InspectionResult known = inspect(cloud, sheet(), options);
  EXPECT_TRUE(known.poses_known);
  EXPECT_NEAR(known.budget.scan_poses, 0.03 / std::sqrt(3.0), 1e-6);
  for (size_t i = 0; i < cloud.size(); i += 37) {
    if (known.point_class[i] != PointClass::kJudged) continue;
    const double noise = std::pow(result.uncertainty_mm[i], 2) - 3e-4;
    EXPECT_NEAR(std::pow(known.uncertainty_mm[i], 2), noise + 6e-4, 1e-6);
  }
}

TEST(Inspection, AlignmentIsReportedAndApplied) {
  PointCloud cloud = sheet_points(0.02f);
  for (auto& p : cloud.points) p += Eigen::Vector3f(0.7f, -0.4f, 0.5f);
  InspectionOptions options;
  options.tolerance_mm = 0.15;
  const InspectionResult result = inspect(cloud, sheet(), options);
  EXPECT_EQ(result.verdict, Verdict::kPass) << result.reason;
  EXPECT_LT((result.alignment.cad_from_cloud.translation() - Eigen::Vector3d(-0.7, 0.4, -0.5)).norm(), 0.05);
  for (size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3d p = result.alignment.cad_from_cloud * cloud.points[i].cast<double>();
    EXPECT_LT((result.cloud.points[i].cast<double>() - p).norm(), 1e-4);
  }
  EXPECT_EQ(inspect(cloud, sheet(), as_it_stands(0.15)).verdict, Verdict::kFail);
}

TEST(Inspection, FixturePointsAreNotJudged) {
  const Eigen::Vector3f low(-5, -5, -12), high(5, 5, -2.02f);
  PointCloud cloud = sheet_points(0.02f);
  // The sheet's underside is hidden where the fixture carries it.
  PointCloud seen;
  for (size_t i = 0; i < cloud.size(); ++i)
    if (cloud.normals[i].z() > -0.5f || cloud.points[i].head<2>().cwiseAbs().maxCoeff() > 5)
      add_point(seen, cloud.points[i], cloud.normals[i], cloud.sigma_mm[i]);
  const size_t part = seen.size();
  const PointCloud fixture = box_points(low, high, kSpacingMm, 0.02f);
  for (size_t i = 0; i < fixture.size(); ++i)
    if (fixture.normals[i].z() < 0.5f)
      add_point(seen, fixture.points[i], fixture.normals[i], fixture.sigma_mm[i]);

  InspectionOptions options;
  options.tolerance_mm = 0.15;
  EXPECT_EQ(inspect(seen, sheet(), options).verdict, Verdict::kFail)
      << "the fixture is no material of the part";
  options.fixture = box_mesh(low, high);
  const InspectionResult result = inspect(seen, sheet(), options);
  EXPECT_EQ(result.verdict, Verdict::kPass) << result.reason;
  for (size_t i = part; i < seen.size(); ++i) {
    EXPECT_EQ(result.point_class[i], PointClass::kFixture) << seen.points[i].transpose();
    EXPECT_TRUE(std::isnan(result.deviation_mm[i]));
  }
  for (size_t i = 0; i < part; ++i) {
    const bool near = seen.normals[i].z() < -0.5f && seen.points[i].head<2>().cwiseAbs().maxCoeff() < 5.5f;
    if (near) {
      EXPECT_EQ(result.point_class[i], PointClass::kFixture);
    } else if (seen.points[i].head<2>().norm() > 9) {
      EXPECT_NE(result.point_class[i], PointClass::kFixture);
    }
  }
}

TEST(Inspection, FarPointsAreClutter) {
  PointCloud cloud = sheet_points(0.02f);
  const size_t part = cloud.size();
  const PointCloud clutter = box_points({-5, -5, 30}, {5, 5, 35}, kSpacingMm, 0.02f);
  for (size_t i = 0; i < clutter.size(); ++i)
    add_point(cloud, clutter.points[i], clutter.normals[i], clutter.sigma_mm[i]);
  const InspectionResult result = inspect(cloud, sheet(), as_it_stands());
  EXPECT_EQ(result.verdict, Verdict::kPass) << result.reason;
  for (size_t i = part; i < cloud.size(); ++i) EXPECT_EQ(result.point_class[i], PointClass::kFar);
}

TEST(Inspection, AShiftedThinWallIsMeasuredToItsOwnFaces) {
  // Shifted by more than half its thickness each face is nearer to the other one.
  PointCloud cloud = sheet_points(0.02f);
  for (auto& p : cloud.points) p.z() += 1.1f;
  const InspectionResult result = inspect(cloud, sheet(), as_it_stands());
  EXPECT_EQ(result.verdict, Verdict::kFail);
  size_t checked = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    const float side = cloud.normals[i].z();
    const bool inner = std::abs(cloud.points[i].x()) < 27 && std::abs(cloud.points[i].y()) < 17;
    if (std::abs(side) < 0.5f || !inner) continue;
    ASSERT_NEAR(result.deviation_mm[i], side > 0 ? 1.1 : -1.1, 0.06);
    ++checked;
  }
  EXPECT_GT(checked, 10000u);
}

TEST(Inspection, WithoutNormalsTheClosestSurfaceCounts) {
  PointCloud cloud = with_top(sheet_points(0.02f), bump(8, -5, 0.6f));
  cloud.normals.clear();
  const InspectionResult result = inspect(cloud, sheet(), as_it_stands());
  EXPECT_EQ(result.verdict, Verdict::kFail) << result.reason;
  ASSERT_GE(result.defects.size(), 1u);
  EXPECT_NEAR(result.defects[0].peak_mm, 0.6, 0.06);
}

TEST(Inspection, TooLittleCoverageIsUndecided) {
  PointCloud quarter;
  const PointCloud cloud = sheet_points(0.02f);
  for (size_t i = 0; i < cloud.size(); ++i)
    if (cloud.normals[i].z() > 0.5f && cloud.points[i].x() > 0)
      add_point(quarter, cloud.points[i], cloud.normals[i], cloud.sigma_mm[i]);
  InspectionOptions options = as_it_stands();
  const InspectionResult result = inspect(quarter, sheet(), options);
  // 30 x 40 mm and a rim of 1 mm, of 5200 mm^2.
  EXPECT_NEAR(result.coverage, 1240.0 / 5200, 0.02);
  EXPECT_EQ(result.verdict, Verdict::kUndecided);
  EXPECT_NE(result.reason.find("seen"), std::string::npos) << result.reason;
  options.min_coverage = 0.2;
  EXPECT_EQ(inspect(quarter, sheet(), options).verdict, Verdict::kPass);
}

TEST(Inspection, NoPeakIsMadeUpBeyondTheRimOfWhatWasMeasured) {
  PointCloud cloud = sheet_points(0.005f);
  for (float y = -15; y < 15; y += kSpacingMm)  // a little over the edge of the top
    add_point(cloud, {30.25f, y, 0}, Eigen::Vector3f::UnitZ(), 0.005f);
  const InspectionResult result = inspect(cloud, sheet(), as_it_stands());
  ASSERT_EQ(result.defects.size(), 1u);
  EXPECT_NEAR(result.defects[0].peak_mm, 0.25, 0.02);
}

TEST(Inspection, WhatTheUncertaintyCannotTellIsUndecided) {
  InspectionOptions options = as_it_stands();
  options.systematic_sigma_mm = 0.05;  // the guard band is a little more than 0.082 mm
  const auto result = [&](float height) {
    return inspect(with_top(sheet_points(0.02f), bump(8, -5, height)), sheet(), options);
  };
  EXPECT_EQ(result(0.09f).verdict, Verdict::kPass);
  const InspectionResult near = result(0.16f);  // in tolerance, but who knows
  EXPECT_EQ(near.verdict, Verdict::kUndecided);
  EXPECT_NE(near.reason.find("within the tolerance"), std::string::npos) << near.reason;
  EXPECT_TRUE(near.defects.empty());
  ASSERT_EQ(near.doubtful.size(), 1u);
  EXPECT_EQ(near.doubtful[0].id, 1);
  EXPECT_FALSE(near.doubtful[0].certain);
  EXPECT_NEAR(near.doubtful[0].peak_mm, 0.16, 0.03);
  EXPECT_LT((near.doubtful[0].centre_mm.head<2>() - Eigen::Vector2d(8, -5)).norm(), 1);
  EXPECT_EQ(std::count(near.defect_id.begin(), near.defect_id.end(), 0),
            static_cast<std::ptrdiff_t>(near.defect_id.size()));
  const InspectionResult out = result(0.25f);
  EXPECT_EQ(out.verdict, Verdict::kUndecided);
  EXPECT_NE(out.reason.find("less than the guard band"), std::string::npos) << out.reason;
  ASSERT_EQ(out.defects.size(), 1u);
  EXPECT_FALSE(out.defects[0].certain);
  EXPECT_TRUE(out.doubtful.empty()) << "what surrounds a defect is no region of its own";
  EXPECT_EQ(result(0.35f).verdict, Verdict::kFail);
  // Without a guard band the measured value decides.
  options.guard_band = 0;
  EXPECT_EQ(result(0.16f).verdict, Verdict::kPass);
  EXPECT_EQ(result(0.25f).verdict, Verdict::kFail);
}

TEST(Inspection, WhatIsFoundInACloudThatIsInDoubtIsNoVerdict) {
  for (const float height : {0.0f, 0.6f}) {
    const InspectionOptions options = as_it_stands();
    PointCloud cloud = with_top(sheet_points(0.02f), bump(8, -5, height));
    const Verdict believed = inspect(cloud, sheet(), options).verdict;
    EXPECT_EQ(believed, height > 0 ? Verdict::kFail : Verdict::kPass);
    const auto sources = std::make_shared<CloudSources>();
    sources->scans = {"scan 1"};
    sources->doubt = "scan 3 contradicts the others";
    for (size_t i = 0; i <= cloud.size(); ++i) sources->first.push_back(static_cast<uint32_t>(i));
    sources->shares.assign(cloud.size(), {0, CloudSources::Share::kWhole});
    cloud.sources = sources;
    const InspectionResult doubted = inspect(cloud, sheet(), options);
    EXPECT_EQ(doubted.verdict, Verdict::kUndecided);
    EXPECT_NE(doubted.reason.find("scan 3 contradicts the others"), std::string::npos) << doubted.reason;
    EXPECT_EQ(doubted.defects.size(), height > 0 ? 1u : 0u) << "shown all the same";
  }
}

TEST(Inspection, AnAlignmentThatFailsIsUndecided) {
  PointCloud cloud = sheet_points(0.02f);
  for (auto& p : cloud.points) p.z() += 300;
  InspectionOptions options;
  options.tolerance_mm = 0.15;
  const InspectionResult result = inspect(cloud, sheet(), options);
  EXPECT_EQ(result.verdict, Verdict::kUndecided);
  EXPECT_NE(result.reason.find("alignment"), std::string::npos) << result.reason;
}

TEST(Inspection, OnlyRegionsCloserThanTheLinkingDistanceMerge) {
  const auto two_patches = [](float gap) {
    return [gap](float x, float y) {
      const float from_middle = std::abs(x);
      return std::abs(y) < 4 && from_middle > gap / 2 && from_middle < gap / 2 + 6 ? 0.5f : 0.0f;
    };
  };
  InspectionOptions options = as_it_stands();
  options.link_distance_mm = 3;
  const auto defects = [&](float gap) {
    return inspect(with_top(sheet_points(0.02f), two_patches(gap)), sheet(), options).defects;
  };
  EXPECT_EQ(defects(1.5f).size(), 1u);
  const auto apart = defects(7);
  ASSERT_EQ(apart.size(), 2u);
  EXPECT_LT(apart[0].centre_mm.x() * apart[1].centre_mm.x(), 0);
  EXPECT_GE(std::abs(apart[0].peak_mm), std::abs(apart[1].peak_mm));
}

TEST(Inspection, SmallRegionsAreNotReported) {
  InspectionOptions options = as_it_stands();
  const PointCloud cloud = with_top(sheet_points(0.02f), bump(8, -5, 0.6f));
  options.min_defect_area_mm2 = 60;
  const InspectionResult result = inspect(cloud, sheet(), options);
  EXPECT_TRUE(result.defects.empty());
  EXPECT_EQ(std::count(result.defect_id.begin(), result.defect_id.end(), 0),
            static_cast<std::ptrdiff_t>(cloud.size()));
}

TEST(Inspection, ThreadsDoNotChangeTheResult) {
  const TriangleMesh part = make_bracket(seeded_defects());
  const PointCloud cloud = mesh_points(part, 60000, 0.03f);
  const SignedDistance nominal(make_bracket());
  InspectionOptions options;
  options.tolerance_mm = 0.2;
  std::vector<InspectionResult> results;
  for (const size_t threads : {1, 2}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    results.push_back(inspect(cloud, nominal, options));
  }
  const auto same = [](const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  EXPECT_TRUE(same(results[0].deviation_mm, results[1].deviation_mm));
  EXPECT_TRUE(same(results[0].uncertainty_mm, results[1].uncertainty_mm));
  EXPECT_EQ(results[0].defect_id, results[1].defect_id);
  EXPECT_EQ(results[0].coverage, results[1].coverage);
  EXPECT_GE(results[0].defects.size(), 3u);
}

TEST(Inspection, OptionsOutOfRangeAreInputErrors) {
  const PointCloud cloud = sheet_points(0.02f);
  const auto expect_refused = [&](const std::function<void(InspectionOptions&)>& spoil,
                                  const std::string& what) {
    InspectionOptions options = as_it_stands();
    spoil(options);
    expect_input_error([&] { inspect(cloud, sheet(), options); }, {"inspection", what});
  };
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  expect_refused([](auto& o) { o.tolerance_mm = 0; }, "tolerance");
  expect_refused([](auto& o) { o.tolerance_mm = -1; }, "tolerance");
  expect_refused([](auto& o) { o.tolerance_mm = kNaN; }, "tolerance");
  expect_refused([](auto& o) { o.max_distance_mm = 0.2; }, "largest distance");
  expect_refused([](auto& o) { o.averaging_radius_mm = -0.1; }, "averaging radius");
  expect_refused([](auto& o) { o.averaging_radius_mm = kNaN; }, "averaging radius");
  expect_refused([](auto& o) { o.link_distance_mm = 0; }, "linking distance");
  expect_refused([](auto& o) { o.min_coverage = 1.1; }, "coverage");
  expect_refused([](auto& o) { o.min_coverage = -0.1; }, "coverage");
  expect_input_error([&] { inspect({}, sheet(), as_it_stands()); }, {"no points"});
}

TEST(Inspection, VerdictsHaveNames) {
  EXPECT_EQ(to_string(Verdict::kPass), "PASS");
  EXPECT_EQ(to_string(Verdict::kFail), "FAIL");
  EXPECT_EQ(to_string(Verdict::kUndecided), "UNDECIDED");
}

}  // namespace
}  // namespace gantry
