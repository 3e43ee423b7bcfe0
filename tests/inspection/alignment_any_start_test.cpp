#include <gtest/gtest.h>

#include "gantry/sim/bracket.h"
#include "gantry/sim/parts.h"
#include "inspection/alignment_samples.h"

namespace gantry {
namespace {

Pose random_pose(uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
                      .normalized()
                      .toRotationMatrix();
  for (int k = 0; k < 3; ++k) pose.translation()[k] = 300 * normal(random);
  return pose;
}

/// Aligns clouds of the part from anywhere; returns how often it ended right. Poses that differ from the
/// truth along `free_axis` through the origin only, or by a turn of half a circle about it, are right.
int right_of(const TriangleMesh& part, int runs, bool turns_freely, float seen_from_z = -1e9f) {
  const SignedDistance model(part);
  AlignmentOptions options;
  options.from_any_start = true;
  int right = 0;
  for (int run = 1; run <= runs; ++run) {
    const auto seed = static_cast<uint32_t>(run);
    PointCloud cloud, all = mesh_points(part, 8000, 0.03f, seed);
    for (size_t i = 0; i < all.size(); ++i)
      if (all.normals[i].z() > seen_from_z) add_point(cloud, all.points[i], all.normals[i], 0.03f);
    const Pose cloud_from_cad = random_pose(seed);
    const AlignmentResult result = align_to_model(moved(cloud, cloud_from_cad), model, options);
    const Pose error = result.cad_from_cloud * cloud_from_cad;
    double worst = 0;
    if (turns_freely) {
      worst = (error * Eigen::Vector3d(0, 0, 100) - Eigen::Vector3d(0, 0, 100)).norm() +
              (error * Eigen::Vector3d::Zero()).norm();
    } else {
      for (const auto& v : part.vertices)
        worst = std::max(worst, (error * v.cast<double>() - v.cast<double>()).norm());
    }
    right += result.converged && worst < 0.05;
    if (!(result.converged && worst < 0.05))
      std::printf("run %d: converged %d, off by %.3f mm, inliers %.3f; %s\n", run, result.converged, worst,
                  result.inlier_fraction, result.status.c_str());
  }
  return right;
}

TEST(AlignmentFromAnyStart, Bracket) {
  EXPECT_EQ(right_of(make_bracket(), 3, false), 3);
}
TEST(AlignmentFromAnyStart, DefectiveBracketAgainstTheGoodOne) {
  const TriangleMesh bad = make_bracket(seeded_defects());
  const SignedDistance model(make_bracket());
  AlignmentOptions options;
  options.from_any_start = true;
  const Pose pose = random_pose(77);
  const AlignmentResult result = align_to_model(moved(mesh_points(bad, 20000, 0.03f), pose), model, options);
  EXPECT_TRUE(result.converged) << result.status;
  EXPECT_LT(rotation_distance(result.cad_from_cloud, pose.inverse()), 2e-4);
}
TEST(AlignmentFromAnyStart, Block) {
  EXPECT_EQ(right_of(make_prismatic_block(), 2, false), 2);
}
TEST(AlignmentFromAnyStart, BlockSeenFromAbove) {
  EXPECT_EQ(right_of(make_prismatic_block(), 2, false, -0.3f), 2);
}
TEST(AlignmentFromAnyStart, TurnedPartUpToItsFreeTurn) {
  EXPECT_EQ(right_of(make_revolved_part(RevolvedFeature::kNone), 2, true), 2);
}

TEST(AlignmentFromAnyStart, ACloudOfAnotherPartIsRefused) {
  const SignedDistance model(box_mesh({0, 0, 0}, {100, 5, 5}));
  AlignmentOptions options;
  options.from_any_start = true;
  const AlignmentResult result =
      align_to_model(mesh_points(box_mesh({0, 0, 0}, {80, 80, 80}), 5000, 0.02f), model, options);
  EXPECT_FALSE(result.converged);
  EXPECT_NE(result.status.find("no pose"), std::string::npos) << result.status;
}

}  // namespace
}  // namespace gantry
