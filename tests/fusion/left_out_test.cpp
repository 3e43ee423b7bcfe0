#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "fusion/scenes.h"
#include "gantry/fusion/joint.h"
#include "gantry/sim/parts.h"
#include "gantry/sim/views.h"
#include "joint/judgement.h"
#include "joint/match_memory.h"
#include "joint/setup.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

struct Scene {
  std::vector<TaggedScan> scans;  ///< Tags wrong by up to a degree and a mm.
  std::vector<Pose> truth;
};

Scene make_scene(const TriangleMesh& part, size_t views, int width) {
  Scene scene;
  const SensorModel model = small_sensor(width);
  const Eigen::Vector3d centre = part.bounds().center().cast<double>();
  scene.truth = poisson_disc_views(part, model, views, 1);
  const RayScene rays(part);
  for (size_t i = 0; i < views; ++i) {
    TaggedScan scan = scan_of(rays, model, scene.truth[i], i, "view" + std::to_string(i));
    scan.part_from_sensor.mean = perturbation(7, i, centre, 0.3, 1) * scene.truth[i];
    scan.part_from_sensor.independent = covariance_about(centre, 1, 1 * kDegree);
    scene.scans.push_back(std::move(scan));
  }
  return scene;
}

const Scene& bracket_scene() {
  static const Scene scene = make_scene(make_bracket(), 8, 800);
  return scene;
}

/// The scans, some of them of another part.
std::vector<RangeSurface> surfaces_with_strangers(const Scene& scene, int width,
                                                  const std::vector<size_t>& strangers) {
  const TriangleMesh lever = make_slim_lever();
  const RayScene rays(lever);
  const SensorModel model = small_sensor(width);
  const std::vector<Pose> views = poisson_disc_views(lever, model, 8, 3);
  std::vector<RangeSurface> surfaces;
  for (size_t i = 0; i < scene.scans.size(); ++i) {
    TaggedScan scan = scene.scans[i];
    if (std::find(strangers.begin(), strangers.end(), i) != strangers.end())
      scan.scan = scan_of(rays, model, views[2 + i % 3], i).scan;
    surfaces.push_back(make_range_surface(scan, {}));
  }
  return surfaces;
}

std::vector<size_t> left_out(const Registration& result) {
  std::vector<size_t> scans;
  for (size_t i = 0; i < result.scans.size(); ++i)
    if (!result.scans[i].left_out.empty()) scans.push_back(i);
  return scans;
}

double worst_mm(const Scene& scene, const std::vector<RangeSurface>& surfaces, const Registration& result) {
  const Pose gauge = scene.truth[0] * result.part_from_sensor[0].mean.inverse();
  double worst = 0;
  for (size_t i = 0; i < surfaces.size(); ++i) {
    if (!result.scans[i].left_out.empty()) continue;
    for (int row = 0; row < surfaces[i].height; row += 5)
      for (int column = 0; column < surfaces[i].width; column += 5) {
        if (surfaces[i].w[surfaces[i].index(column, row)] == 0) continue;
        const Eigen::Vector3d p = surfaces[i].sensor_from_grid * surfaces[i].point(column, row);
        worst = std::max(worst, (gauge * result.part_from_sensor[i].mean * p - scene.truth[i] * p).norm());
      }
  }
  return worst;
}

TEST(LeftOut, AStrangeScanIsNamedAndTheOthersAreRight) {
  const std::vector<RangeSurface> surfaces = surfaces_with_strangers(bracket_scene(), 800, {5});
  const Registration result = register_joint(surfaces, {});
  EXPECT_EQ(left_out(result), std::vector<size_t>{5});
  EXPECT_NE(result.reason.find("1 of 8 scans left out"), std::string::npos) << result.reason;
  EXPECT_NE(result.reason.find("view5"), std::string::npos) << result.reason;
  EXPECT_LT(worst_mm(bracket_scene(), surfaces, result), 0.2);
  for (const PairReport& pair : result.pairs)
    EXPECT_EQ(pair.kept, pair.target != 5 && pair.source != 5) << pair.reason;
  EXPECT_GT(result.part_from_sensor[5].covariance().trace(), 0);

  // Only who allows it explicitly gets a result that counts; it is the same one.
  JointOptions options;
  options.allowed_left_out = 1;
  const Registration allowed = register_joint(surfaces, options);
  EXPECT_EQ(allowed.reason, "");
  EXPECT_EQ(left_out(allowed), std::vector<size_t>{5});
  EXPECT_EQ(allowed.part_from_sensor[3].mean.matrix(), result.part_from_sensor[3].mean.matrix());
}

TEST(LeftOut, NotTheFirstScan) {
  const Registration result =
      register_joint(surfaces_with_strangers(bracket_scene(), 800, {0}), {.allowed_left_out = 8});
  EXPECT_NE(result.reason, "");
  EXPECT_TRUE(left_out(result).empty());
}

TEST(LeftOut, EvidenceOfTheOthersIsTheirsAlone) {
  const std::vector<RangeSurface> surfaces = surfaces_with_strangers(bracket_scene(), 800, {5});
  const internal::JointProblem problem = internal::make_problem(surfaces, {});
  internal::Poses poses;
  for (size_t i = 0; i < 8; ++i) poses.push_back(bracket_scene().truth[i] * surfaces[i].sensor_from_grid);
  internal::Evidence evidence = internal::gather_evidence(problem, poses, 0.05);
  EXPECT_GT(evidence.worst_violation, 0.01);
  std::vector<bool> out(8, false);
  out[5] = true;
  evidence.leave_out(out);
  EXPECT_LT(evidence.worst_violation, 0.01);
  for (const auto& [a, b] : evidence.pairs) EXPECT_TRUE(a != 5 && b != 5);
  for (const auto& [a, b] : evidence.pairs_of_left_out) EXPECT_TRUE(a == 5 || b == 5);
  EXPECT_EQ(evidence.pairs.size() + evidence.pairs_of_left_out.size(), evidence.all_pairs.size());
  out[5] = false;
  evidence.leave_out(out);
  EXPECT_GT(evidence.worst_violation, 0.01);
}

TEST(MatchMemory, FollowsSmallMotionsAndForgetsWhatMoved) {
  const std::vector<RangeSurface> surfaces = surfaces_with_strangers(bracket_scene(), 800, {});
  const internal::JointProblem problem = internal::make_problem(surfaces, {});
  internal::Poses poses;
  for (size_t i = 0; i < 8; ++i) poses.push_back(bracket_scene().truth[i] * surfaces[i].sensor_from_grid);
  internal::MatchGates gates;
  gates.scale_mm = 1;
  gates.stride = 2;
  internal::PairSum surface;
  internal::RawSums kept, recalled;
  const auto match = [&] {
    return internal::match_by_projection(surfaces[0], surfaces[1], poses[0].inverse() * poses[1], poses[0],
                                         problem.centre, gates, 0, surfaces[1].height);
  };
  surface = match();
  internal::MatchMemory memory;
  EXPECT_FALSE(memory.recall(problem, 0, 1, poses, gates, recalled));
  kept.surfaces = surface;
  memory.keep(0, 1, poses, gates, kept);
  ASSERT_TRUE(memory.recall(problem, 0, 1, poses, gates, recalled));
  EXPECT_LT((recalled.surfaces.gradient - surface.gradient).norm(), 1e-6 * surface.gradient.norm());

  const Pose at_rest = poses[1];
  Vector6d motion = Vector6d::Zero();
  motion.tail<3>() = 0.08 * problem.noise_mm * Eigen::Vector3d(0.6, -0.64, 0.48);
  poses[1] = internal::exp_about(problem.centre, motion) * at_rest;
  ASSERT_TRUE(memory.recall(problem, 0, 1, poses, gates, recalled));
  const Vector6d change = match().gradient - surface.gradient;
  EXPECT_LT((recalled.surfaces.gradient - surface.gradient - change).tail<3>().norm(),
            0.1 * change.tail<3>().norm());
  // Both moved together: nothing has changed between them.
  const Pose first = poses[0];
  poses[0] = internal::exp_about(problem.centre, 100 * motion) * first;
  poses[1] = internal::exp_about(problem.centre, 100 * motion) * at_rest;
  EXPECT_TRUE(memory.recall(problem, 0, 1, poses, gates, recalled));
  poses[1] = at_rest;
  EXPECT_FALSE(memory.recall(problem, 0, 1, poses, gates, recalled));
  poses[0] = first;
  EXPECT_TRUE(memory.recall(problem, 0, 1, poses, gates, recalled));
  internal::MatchGates narrower = gates;
  narrower.scale_mm = 0.5;
  EXPECT_FALSE(memory.recall(problem, 0, 1, poses, narrower, recalled));
}

}  // namespace
}  // namespace gantry
