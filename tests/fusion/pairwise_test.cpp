#include "gantry/fusion/pairwise.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <numbers>

#include "fusion/scenes.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

ScanSurface surface_of(const RayScene& scene, const Pose& scene_from_sensor, uint64_t number) {
  return preprocess(scan_of(scene, small_sensor(960), scene_from_sensor, number), {});
}

Matrix6d symmetric_part(const Matrix6d& m) {
  return 0.5 * (m + m.transpose());
}

TEST(Pairwise, RecoversAPerturbedView) {
  const RayScene scene(make_bracket());
  const ScanSurface a = surface_of(scene, bracket_view(0.5, 0.9), 1);
  const ScanSurface b = surface_of(scene, bracket_view(1.1, 1.0), 2);
  const MatchTarget target(a);
  const Pose truth = a.part_from_sensor.mean.inverse() * b.part_from_sensor.mean;
  const Eigen::Vector3d centre = a.part_from_sensor.mean.inverse() * bracket_middle();
  std::mt19937 random(11);
  for (int trial = 0; trial < 3; ++trial) {
    const Pose start = random_motion(random, centre, 0.5, 0.3 * kDegree) * truth;
    const PairwiseResult result = register_pair(target, b, start, {});
    EXPECT_TRUE(result.converged);
    EXPECT_GT(result.overlap, 0.3);
    EXPECT_LT(worst_displacement_mm(b, result.target_from_source, truth), 0.05)
        << "started at " << worst_displacement_mm(b, start, truth);
    EXPECT_GT(result.normalised_rms, 0.5);
    EXPECT_LT(result.normalised_rms, 2);
    EXPECT_NEAR((result.information - result.information.transpose()).norm(), 0,
                1e-6 * result.information.norm());
    const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(symmetric_part(result.information));
    EXPECT_GT(solver.eigenvalues()(0), 0);
  }
}

TEST(Pairwise, FacesOfAThinPlateStayApart) {
  const RayScene scene(box_mesh({-50, -35, -1}, {50, 35, 1}));
  // Seen aslant, so that both views also share an edge.
  const ScanSurface above = surface_of(scene, looking_at({150, 0, 480}, {0, 0, 0}), 1);
  const ScanSurface below = surface_of(scene, looking_at({150, 0, -480}, {0, 0, 0}), 2);
  const Pose truth = above.part_from_sensor.mean.inverse() * below.part_from_sensor.mean;
  PairwiseOptions options;
  options.max_distance_mm = 10;
  const PairwiseResult result = register_pair(MatchTarget(above), below, truth, options);
  EXPECT_LT(static_cast<double>(result.inliers), 0.02 * static_cast<double>(below.cloud.size()));
  // Across the plate: distance between the faces must not shrink.
  const Eigen::Vector3d moved = above.part_from_sensor.mean * result.target_from_source *
                                below.part_from_sensor.mean.inverse() * Eigen::Vector3d(0, 0, -1);
  EXPECT_NEAR(moved.z(), -1, 0.1);
}

TEST(Pairwise, InformationOfAPlaneIsNearlyZeroAlongIt) {
  const RayScene scene(box_mesh({-150, -150, -5}, {150, 150, 0}));
  const ScanSurface a = surface_of(scene, looking_at({0, 0, 500}, {0, 0, 0}), 1);
  const ScanSurface b = surface_of(scene, looking_at({20, 10, 500}, {20, 10, 0}), 2);
  const PairwiseResult result =
      register_pair(MatchTarget(a), b, a.part_from_sensor.mean.inverse() * b.part_from_sensor.mean, {});
  ASSERT_GT(result.inliers, 1000u);
  EXPECT_NEAR((result.information - result.information.transpose()).norm(), 0,
              1e-6 * result.information.norm());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(symmetric_part(result.information));
  EXPECT_GE(solver.eigenvalues()(0), -1e-12 * solver.eigenvalues()(5));
  // Along the two directions of the plane and turning in it, against moving off it.
  const double off = result.information(5, 5);
  EXPECT_LT(result.information(3, 3), 1e-3 * off);
  EXPECT_LT(result.information(4, 4), 1e-3 * off);
}

TEST(Pairwise, WithoutOverlapNothingMatches) {
  const RayScene scene(make_bracket());
  const ScanSurface a = surface_of(scene, bracket_view(0.5, 0.9), 1);
  const ScanSurface b = surface_of(scene, bracket_view(1.1, 1.0), 2);
  Pose far = Pose::Identity();
  far.translation() = Eigen::Vector3d(1000, 0, 0);
  const PairwiseResult result = register_pair(MatchTarget(a), b, far, {});
  EXPECT_EQ(result.inliers, 0u);
  EXPECT_FALSE(result.converged);
  EXPECT_EQ(result.information.norm(), 0);
  EXPECT_TRUE(result.target_from_source.isApprox(far));
}

}  // namespace
}  // namespace gantry
