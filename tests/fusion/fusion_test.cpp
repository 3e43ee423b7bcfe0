#include "gantry/fusion/fusion.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <numbers>
#include <thread>

#include "foundation/expect_input_error.h"
#include "fusion/scenes.h"
#include "gantry/geometry/surface_index.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kTagShiftMm = 0.6, kTagRotationRad = 0.3 * kDegree;

/// Four views around the bracket. All tags but the first are wrong, by as much as their covariance says.
struct Views {
  std::vector<TaggedScan> scans;
  std::vector<Pose> truth;
};

const Views& bracket_views() {
  static const Views views = [] {
    Views v;
    std::mt19937 random(31);
    const RayScene scene(make_bracket());
    for (int i = 0; i < 4; ++i) {
      v.truth.push_back(bracket_view(0.4 + i * std::numbers::pi / 2, 0.9));
      TaggedScan scan = scan_of(scene, small_sensor(960), v.truth.back(), static_cast<uint64_t>(i),
                                "view" + std::to_string(i));
      if (i > 0)
        scan.part_from_sensor.mean =
            random_motion(random, bracket_middle(), kTagShiftMm, kTagRotationRad) * v.truth.back();
      scan.part_from_sensor.independent = covariance_about(bracket_middle(), kTagShiftMm, kTagRotationRad);
      v.scans.push_back(std::move(scan));
    }
    return v;
  }();
  return views;
}

constexpr RegistrationMethod kAllMethods[] = {RegistrationMethod::kJoint,
                                              RegistrationMethod::kRefinedPoseGraph,
                                              RegistrationMethod::kPoseGraph, RegistrationMethod::kGlobalIcp};

FusionResult fuse(const std::vector<TaggedScan>& scans,
                  RegistrationMethod method = RegistrationMethod::kJoint) {
  FusionOptions options;
  options.method = method;
  Fusion fusion(options);
  for (const TaggedScan& scan : scans) fusion.add(scan);
  EXPECT_EQ(fusion.size(), scans.size());
  return fusion.finish();
}

bool same_bits(const Pose& a, const Pose& b) {
  return std::memcmp(a.data(), b.data(), 16 * sizeof(double)) == 0;
}

TEST(Fusion, MethodsHaveNames) {
  for (const RegistrationMethod method : kAllMethods)
    EXPECT_EQ(registration_method(to_string(method)), method);
  EXPECT_EQ(to_string(FusionOptions().method), "joint");
  expect_input_error([] { registration_method("icp"); },
                     {"icp", "joint", "refined-pose-graph", "global-icp"});
}

class FusionMethod : public ::testing::TestWithParam<RegistrationMethod> {};

INSTANTIATE_TEST_SUITE_P(All, FusionMethod, ::testing::ValuesIn(kAllMethods), [](const auto& method) {
  std::string name(to_string(method.param));
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

TEST_P(FusionMethod, PutsTheViewsTogether) {
  const Views& views = bracket_views();
  const FusionResult result = fuse(views.scans, GetParam());
  EXPECT_TRUE(result.trusted) << result.reason;
  EXPECT_EQ(result.merged.sources->doubt, "");
  EXPECT_EQ(result.reason, "");
  EXPECT_EQ(result.advice, "");
  EXPECT_EQ(result.method, GetParam());
  EXPECT_EQ(result.sides_guessed, 0u);
  EXPECT_FALSE(result.registration.pairs.empty());
  EXPECT_FALSE(result.registration.parameters.empty());
  ASSERT_EQ(result.registration.scans.size(), 4u);
  ASSERT_EQ(result.scans.size(), 4u);
  EXPECT_TRUE(same_bits(result.scans[0].part_from_sensor.mean, views.scans[0].part_from_sensor.mean));
  for (size_t i = 0; i < 4; ++i) {
    const ScanResult& scan = result.scans[i];
    const ScanSurface surface = preprocess(views.scans[i], {});
    const double before =
        worst_displacement_mm(surface, views.scans[i].part_from_sensor.mean, views.truth[i]);
    const double after = worst_displacement_mm(surface, scan.part_from_sensor.mean, views.truth[i]);
    EXPECT_EQ(scan.name, "view" + std::to_string(i));
    EXPECT_TRUE(scan.connected);
    EXPECT_EQ(scan.points, surface.cloud.size());
    EXPECT_EQ(scan.measured, views.scans[i].scan.valid_count());
    EXPECT_EQ(scan.points + scan.dropped_edges + scan.dropped_crop, scan.measured);
    EXPECT_LT(after, GetParam() == RegistrationMethod::kJoint ? 0.05 : 0.1) << "before: " << before;
    EXPECT_LT(result.registration.scans[i].free_space_violation, 0.005);
    if (i > 0) {
      EXPECT_GT(before, 0.5);
      EXPECT_NEAR(scan.moved_mm, kTagShiftMm, 0.25);
      EXPECT_NEAR(scan.turned_rad, kTagRotationRad, 0.1 * kTagRotationRad);
    }
  }
  EXPECT_GT(result.before.matches, 10000u);
  EXPECT_LT(result.after.rms_mm, 0.5 * result.before.rms_mm);
  // Two noisy points are compared: sqrt(2) times the sensor's noise, a tenth trimmed.
  EXPECT_LT(result.after.rms_mm, 0.09);
}

TEST_P(FusionMethod, DoesNotTrustAScanThatLiesWhereAnotherLookedThrough) {
  std::vector<TaggedScan> scans = bracket_views().scans;
  Pose astray = Pose::Identity();
  astray.translation() = Eigen::Vector3d(5, 0, 7);
  scans[2].part_from_sensor.mean = astray * bracket_views().truth[2];
  // The tag is as sure of itself as it is wrong.
  for (TaggedScan& scan : scans)
    scan.part_from_sensor.independent = covariance_about(bracket_middle(), 1e-4, 1e-6);
  const FusionResult result = fuse(scans, GetParam());
  EXPECT_FALSE(result.trusted);
  EXPECT_NE(result.reason.find("view2"), std::string::npos) << result.reason;
  EXPECT_EQ(result.merged.sources->doubt, result.reason) << "whoever inspects the cloud must know";
  EXPECT_NE(result.advice, "");
}

TEST(Fusion, MergesNoScanThatIsLeftOut) {
  std::vector<TaggedScan> scans = bracket_views().scans;
  for (size_t i = 0; i < scans.size(); ++i) {
    scans[i].part_from_sensor.mean = bracket_views().truth[i];
    scans[i].part_from_sensor.independent = covariance_about(bracket_middle(), 1e-4, 1e-6);
  }
  Pose astray = Pose::Identity();
  astray.translation() = Eigen::Vector3d(5, 0, 7);
  scans[2].part_from_sensor.mean = astray * bracket_views().truth[2];
  for (const size_t allowed : {0, 1}) {
    FusionOptions options;
    options.joint.allowed_left_out = allowed;
    Fusion fusion(options);
    for (const TaggedScan& scan : scans) fusion.add(scan);
    const FusionResult result = fusion.finish();
    EXPECT_EQ(result.trusted, allowed == 1) << result.reason;
    EXPECT_EQ(result.advice.empty(), allowed == 1) << result.advice;
    ASSERT_EQ(result.scans.size(), 4u);
    for (size_t i = 0; i < 4; ++i) EXPECT_EQ(result.scans[i].left_out.empty(), i != 2) << i;
    const SurfaceIndex part(make_bracket());
    ASSERT_GT(result.merged.size(), 10000u);
    size_t far = 0;
    for (const auto& p : result.merged.points) far += !part.closest(p, 0.3f).has_value();
    EXPECT_LT(static_cast<double>(far), 2e-3 * static_cast<double>(result.merged.size()));
  }
}

TEST_P(FusionMethod, DoesNotCareWhereTheOriginIs) {
  const auto poses_at = [](const Eigen::Vector3d& origin) {
    Pose away = Pose::Identity();
    away.translation() = origin;
    FusionOptions options;
    options.method = GetParam();
    options.merge_scans = false;
    Fusion fusion(options);
    for (TaggedScan scan : bracket_views().scans) {
      scan.part_from_sensor.mean = away * scan.part_from_sensor.mean;
      scan.part_from_sensor.independent =
          adjoint(away) * scan.part_from_sensor.independent * adjoint(away).transpose();
      fusion.add(scan);
    }
    std::vector<UncertainPose> poses = fusion.finish().registration.part_from_sensor;
    for (UncertainPose& pose : poses) {
      pose.mean = away.inverse() * pose.mean;
      pose.independent = adjoint(away.inverse()) * pose.independent * adjoint(away.inverse()).transpose();
    }
    return poses;
  };
  const auto here = poses_at({0, 0, 0}), far = poses_at({6000, -7000, 4000});  // 10 m
  for (size_t i = 1; i < here.size(); ++i) {
    for (const Eigen::Vector3d& p : {Eigen::Vector3d(0, -20, 0), Eigen::Vector3d(120, 20, 40)})
      EXPECT_LT((far[i].mean * here[i].mean.inverse() * p - p).norm(), 1e-5) << i;
    EXPECT_NEAR(point_sigma_mm(far[i].independent, bracket_middle()) /
                    point_sigma_mm(here[i].independent, bracket_middle()),
                1, 1e-3);
  }
}

TEST(Fusion, MergedCloudLiesOnThePart) {
  const FusionResult result = fuse(bracket_views().scans);
  const SurfaceIndex part(make_bracket());
  ASSERT_GT(result.merged.size(), 10000u);
  ASSERT_TRUE(result.merged.has_normals());
  ASSERT_TRUE(result.merged.has_sigma());
  EXPECT_GT(result.merge.voxel_mm, 0);
  size_t far = 0;
  for (const auto& p : result.merged.points) far += !part.closest(p, 0.3f).has_value();
  EXPECT_LT(static_cast<double>(far), 2e-3 * static_cast<double>(result.merged.size()));
}

TEST(Fusion, ThreadsDoNotChangeTheResult) {
  std::vector<FusionResult> results;
  for (const size_t threads : {1, 2}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    results.push_back(fuse(bracket_views().scans));
  }
  for (size_t i = 0; i < 4; ++i)
    EXPECT_TRUE(
        same_bits(results[0].scans[i].part_from_sensor.mean, results[1].scans[i].part_from_sensor.mean));
  EXPECT_EQ(results[0].after.rms_mm, results[1].after.rms_mm);
  ASSERT_EQ(results[0].merged.size(), results[1].merged.size());
  EXPECT_EQ(std::memcmp(results[0].merged.points.data(), results[1].merged.points.data(),
                        results[0].merged.size() * sizeof(Eigen::Vector3f)),
            0);
}

TEST(Fusion, ThePaceOfArrivalDoesNotChangeTheResult) {
  const std::vector<TaggedScan>& tagged = bracket_views().scans;
  std::vector<RangeSurface> surfaces;
  for (const TaggedScan& scan : tagged) surfaces.push_back(make_range_surface(scan, {}));
  const Registration batch = register_joint(surfaces, {});

  Fusion fusion({});
  for (size_t i = 0; i < tagged.size(); ++i) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1 + i % 2);
    std::thread([&] { fusion.add(tagged[i]); }).join();
    std::this_thread::sleep_for(std::chrono::milliseconds(5 * i));
  }
  const FusionResult result = fusion.finish();
  for (size_t i = 0; i < tagged.size(); ++i) {
    EXPECT_TRUE(same_bits(result.scans[i].part_from_sensor.mean, batch.part_from_sensor[i].mean));
    EXPECT_EQ(result.scans[i].part_from_sensor.covariance(), batch.part_from_sensor[i].covariance());
  }
}

TEST_P(FusionMethod, AScanWithNothingInCommonIsNotTrusted) {
  std::vector<TaggedScan> scans(bracket_views().scans.begin(), bracket_views().scans.begin() + 2);
  const RayScene elsewhere(box_mesh({400, 400, 0}, {480, 460, 30}));
  scans.push_back(
      scan_of(elsewhere, small_sensor(), looking_at({440, 430, 530}, {440, 430, 30}), 9, "astray"));
  scans.back().part_from_sensor.independent = scans[1].part_from_sensor.independent;
  const FusionResult result = fuse(scans, GetParam());
  EXPECT_FALSE(result.trusted);
  EXPECT_NE(result.reason.find("astray"), std::string::npos) << result.reason;
  EXPECT_EQ(result.reason.find("view"), std::string::npos) << result.reason;
  EXPECT_TRUE(result.scans[1].connected);
  EXPECT_FALSE(result.scans[2].connected);
  EXPECT_NE(result.advice, "");
  if (GetParam() == RegistrationMethod::kJoint) return;  // it searches for lost scans, and moves them
  EXPECT_LT(translation_distance(result.scans[2].part_from_sensor.mean, scans[2].part_from_sensor.mean),
            1e-6);
}

TEST(Fusion, GoesOnWithoutAnUnusableScan) {
  TaggedScan empty = bracket_views().scans[1];
  empty.name = "empty";
  empty.scan.points.assign(empty.scan.points.size(), invalid_point());
  Fusion fusion({});
  fusion.add(bracket_views().scans[0]);
  expect_input_error([&] { fusion.add(empty); }, {"empty"});
  fusion.add(bracket_views().scans[1]);
  EXPECT_EQ(fusion.size(), 2u);
  const FusionResult result = fusion.finish();
  EXPECT_TRUE(result.trusted) << result.reason;
  EXPECT_EQ(result.scans.size(), 2u);
}

TEST(Fusion, WithoutScansThereIsNothingToFinish) {
  Fusion fusion({});
  expect_input_error([&] { fusion.finish(); }, {"no scan"});
}

TEST(Fusion, RefusesTheSameScanTwice) {
  TaggedScan again = bracket_views().scans[0];
  again.name = "again";
  Fusion fusion({});
  fusion.add(bracket_views().scans[0]);
  expect_input_error([&] { fusion.add(again); }, {"again", "view0", "same points"});
  EXPECT_EQ(fusion.size(), 1u);
}

TEST(Fusion, OptionsOutOfRangeAreNamed) {
  FusionOptions options;
  options.preprocess.edge_margin_px = -1;
  expect_input_error([&] { Fusion fusion(options); }, {"edge_margin_px"});
  options = {};
  options.joint.noise_mm = -1;
  Fusion fusion(options);
  fusion.add(bracket_views().scans[0]);
  expect_input_error([&] { fusion.finish(); }, {"noise_mm"});
}

TEST(Fusion, PosesCanBeHadWithoutMerging) {
  FusionOptions options;
  options.merge_scans = false;
  Fusion fusion(options);
  for (const TaggedScan& scan : bracket_views().scans) fusion.add(scan);
  const FusionResult result = fusion.finish();
  EXPECT_TRUE(result.trusted) << result.reason;
  EXPECT_EQ(result.merged.size(), 0u);
}

TEST_P(FusionMethod, OneScanIsItsOwnResult) {
  const FusionResult result = fuse({bracket_views().scans[0]}, GetParam());
  EXPECT_TRUE(result.trusted) << result.reason;
  EXPECT_TRUE(result.registration.pairs.empty());
  EXPECT_TRUE(
      same_bits(result.scans[0].part_from_sensor.mean, bracket_views().scans[0].part_from_sensor.mean));
  EXPECT_GT(result.merged.size(), 1000u);
}

}  // namespace
}  // namespace gantry
