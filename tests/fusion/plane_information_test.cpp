#include "gantry/fusion/pairwise.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "fusion/scenes.h"

namespace gantry {
namespace {

/// Points of a grid on x = 0, or also on the other coordinate planes, with normals wrong by about `tilt_rad`.
ScanSurface planes(int count, double tilt_rad, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  ScanSurface surface;
  for (int axis = 0; axis < count; ++axis)
    for (int i = 0; i < 60; ++i)
      for (int j = 0; j < 60; ++j) {
        Eigen::Vector3d p = Eigen::Vector3d::Zero(), n = Eigen::Vector3d::Zero();
        p[(axis + 1) % 3] = 0.5 * i + 1;
        p[(axis + 2) % 3] = 0.5 * j + 1;
        n[axis] = 1;
        for (int k = 0; k < 3; ++k) n[k] += tilt_rad * normal(random);
        surface.cloud.points.push_back(p.cast<float>());
        surface.cloud.normals.push_back(n.normalized().cast<float>());
        surface.cloud.sigma_mm.push_back(0.05f);
        surface.rim.push_back(0);
      }
  surface.spacing_mm = 0.5;
  surface.noise_mm = 0.05;
  return surface;
}

int known_directions(const Matrix6d& information) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(information);
  return static_cast<int>((solver.eigenvalues().array() > 1e-9 * solver.eigenvalues()(5)).count());
}

TEST(PlaneInformation, AFlatOverlapLeavesThreeDirectionsFree) {
  for (const PairwiseMethod method : {PairwiseMethod::kPointToPlane, PairwiseMethod::kGeneralizedIcp}) {
    const ScanSurface a = planes(1, 0, 1), b = planes(1, 0, 2);
    PairwiseOptions options;
    options.method = method;
    const PairwiseResult result = register_pair(MatchTarget(a), b, Pose::Identity(), options);
    ASSERT_GT(result.inliers, 1000u);
    EXPECT_EQ(known_directions(result.information), 3);
  }
}

TEST(PlaneInformation, ThreePlanesHoldAll) {
  const ScanSurface a = planes(3, 0, 1), b = planes(3, 0, 2);
  const PairwiseResult result = register_pair(MatchTarget(a), b, Pose::Identity(), {});
  EXPECT_EQ(known_directions(result.information), 6);
}

TEST(PlaneInformation, NoisyNormalsDoNotPretendToHoldASlide) {
  const ScanSurface a = planes(1, 0.035, 1), b = planes(1, 0.035, 2);
  PairwiseOptions options;
  options.samples = 0;
  const PairwiseResult result = register_pair(MatchTarget(a), b, Pose::Identity(), options);
  const double off = result.information(3, 3);
  ASSERT_GT(off, 0);
  // The plain sum of n n^T would claim 0.035^2 = 1.2e-3 of what holds the planes together.
  EXPECT_LT(result.information(4, 4), 2e-4 * off);
  EXPECT_LT(result.information(5, 5), 2e-4 * off);
}

}  // namespace
}  // namespace gantry
