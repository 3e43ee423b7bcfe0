#include "gantry/fusion/pose_graph_registration.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <numbers>

#include "fusion/scenes.h"
#include "gantry/foundation/error.h"
#include "gantry/fusion/global_icp.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// Four views of the bracket from above; the tags of all but the first are off by `shift_mm` and as many
/// degrees.
struct Scene {
  std::vector<ScanSurface> surfaces;
  std::vector<Pose> truth;
};

Scene bracket_scene(double shift_mm) {
  const RayScene scene(make_bracket());
  Scene out;
  std::mt19937 random(31);
  for (int i = 0; i < 4; ++i) {
    const Pose pose = bracket_view(0.4 + 0.5 * i, 0.9);
    ScanSurface surface = preprocess(scan_of(scene, small_sensor(640), pose, i + 1), {});
    if (i > 0)
      surface.part_from_sensor.mean =
          random_motion(random, bracket_middle(), shift_mm, shift_mm * kDegree) * pose;
    surface.part_from_sensor.independent = covariance_about(bracket_middle(), shift_mm, shift_mm * kDegree);
    out.surfaces.push_back(std::move(surface));
    out.truth.push_back(pose);
  }
  return out;
}

void expect_found(const Scene& scene, const Registration& result, double limit_mm) {
  EXPECT_TRUE(result.converged) << result.reason;
  ASSERT_EQ(result.part_from_sensor.size(), scene.surfaces.size());
  EXPECT_TRUE(result.part_from_sensor[0].mean.isApprox(scene.surfaces[0].part_from_sensor.mean, 1e-14));
  EXPECT_EQ(result.part_from_sensor[0].covariance().norm(), 0);
  for (size_t i = 1; i < scene.truth.size(); ++i)
    EXPECT_LT(worst_displacement_mm(scene.surfaces[i], result.part_from_sensor[i].mean, scene.truth[i]),
              limit_mm)
        << i;
}

TEST(PoseGraphRegistration, BothMethodsFindTheViews) {
  const Scene scene = bracket_scene(1);
  expect_found(scene, register_refined_pose_graph(scene.surfaces, {}), 0.1);
  expect_found(scene, register_pose_graph(scene.surfaces, {}), 0.1);
}

TEST(PoseGraphRegistration, DoesNotDependOnThreads) {
  const Scene scene = bracket_scene(1);
  const Registration two = register_refined_pose_graph(scene.surfaces, {});
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  const Registration one = register_refined_pose_graph(scene.surfaces, {});
  for (size_t i = 0; i < scene.truth.size(); ++i)
    EXPECT_EQ(two.part_from_sensor[i].mean.matrix(), one.part_from_sensor[i].mean.matrix());
}

TEST(PoseGraphRegistration, BadOptionsAreRejected) {
  const Scene scene = bracket_scene(0.1);
  PoseGraphRegistrationOptions options;
  options.min_overlap = 2;
  EXPECT_THROW(register_pose_graph(scene.surfaces, options), InputError);
  options = {};
  options.parameters.m = 9;
  EXPECT_THROW(register_pose_graph(scene.surfaces, options), InputError);
  EXPECT_THROW(register_pose_graph({}, {}), InputError);
}

TEST(GlobalIcp, EveryStrategyFindsTheViews) {
  const Scene scene = bracket_scene(1);
  for (const SamplingStrategy sampling :
       {SamplingStrategy::kUniform, SamplingStrategy::kRandom, SamplingStrategy::kNormalSpace,
        SamplingStrategy::kMaximumLeverage}) {
    SCOPED_TRACE(to_string(sampling));
    GlobalIcpOptions options;
    options.sampling = sampling;
    options.samples = 5000;
    expect_found(scene, register_global_icp(scene.surfaces, options), 0.15);
  }
}

TEST(GlobalIcp, DoesNotDependOnThreads) {
  const Scene scene = bracket_scene(1);
  const Registration two = register_global_icp(scene.surfaces, {});
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  const Registration one = register_global_icp(scene.surfaces, {});
  for (size_t i = 0; i < scene.truth.size(); ++i)
    EXPECT_EQ(two.part_from_sensor[i].mean.matrix(), one.part_from_sensor[i].mean.matrix());
}

TEST(GlobalIcp, BadOptionsAreRejected) {
  const Scene scene = bracket_scene(0.1);
  const auto refused = [&](auto change) {
    GlobalIcpOptions options;
    change(options);
    EXPECT_THROW(register_global_icp(scene.surfaces, options), InputError);
  };
  refused([](auto& o) { o.samples = 3; });
  refused([](auto& o) { o.max_deviation_mads = 0; });
  refused([](auto& o) { o.max_roughness_sigmas = -1; });
  refused([](auto& o) { o.max_angle_rad = 4; });
  refused([](auto& o) { o.start_angle_rad = 0.1; });
  refused([](auto& o) { o.max_iterations = 0; });
  refused([](auto& o) { o.tolerance_mm = std::nan(""); });
}

}  // namespace
}  // namespace gantry
