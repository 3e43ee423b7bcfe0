#include "gantry/inspection/alignment.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>

#include "gantry/sim/bracket.h"
#include "inspection/alignment_samples.h"

namespace gantry {
namespace {

constexpr float kNoiseMm = 0.02f;

const TriangleMesh& bracket() {
  static const TriangleMesh mesh = make_bracket();
  return mesh;
}

const SignedDistance& model() {
  static const SignedDistance distance(bracket());
  return distance;
}

/// 2 mm and 1.5 degrees about the part's middle.
Pose offset() {
  const Eigen::Vector3d middle(60, 0, 20);
  Pose pose = Pose::Identity();
  pose.linear() = rotation_exp(1.5 * std::numbers::pi / 180 * Eigen::Vector3d(1, -2, 1.5).normalized());
  pose.translation() = middle - pose.linear() * middle + 2 * Eigen::Vector3d(2, 1, -1).normalized();
  return pose;
}

/// How far from the truth any point of the part is put.
double worst_error_mm(const AlignmentResult& result) {
  const Pose error = result.cad_from_cloud * offset();
  double worst = 0;
  for (const auto& v : bracket().vertices)
    worst = std::max(worst, (error * v.cast<double>() - v.cast<double>()).norm());
  return worst;
}

TEST(Alignment, RecoversAKnownOffset) {
  for (const uint32_t seed : {1u, 2u, 3u}) {
    const AlignmentResult result =
        align_to_model(moved(mesh_points(bracket(), 40000, kNoiseMm, seed), offset()), model(), {});
    EXPECT_TRUE(result.converged);
    EXPECT_LT(worst_error_mm(result), 0.005) << "seed " << seed;
    EXPECT_GT(result.rms_before_mm, 0.5);
    EXPECT_NEAR(result.rms_after_mm, kNoiseMm, 0.2 * kNoiseMm);
    EXPECT_GT(result.inlier_fraction, 0.97);
  }
}

TEST(Alignment, ABentFlangeDoesNotPull) {
  PointCloud cloud = mesh_points(bracket(), 40000, kNoiseMm);
  size_t displaced = 0;
  for (auto& p : cloud.points) {
    if (p.x() < 113 || p.z() < 6) continue;
    p.x() += 0.5f;
    ++displaced;
  }
  const double fraction = static_cast<double>(displaced) / static_cast<double>(cloud.size());
  ASSERT_GT(fraction, 0.1);
  ASSERT_LT(fraction, 0.2);
  const AlignmentResult result = align_to_model(moved(cloud, offset()), model(), {});
  EXPECT_TRUE(result.converged);
  EXPECT_LT(worst_error_mm(result), 0.03);
  EXPECT_NEAR(result.inlier_fraction, 1 - fraction, 0.05);
  EXPECT_GT(result.masked_fraction, 0.95 * fraction);
  EXPECT_GE(result.masked_regions, 1);
}

TEST(Alignment, WorksWithoutNormals) {
  PointCloud cloud = moved(mesh_points(bracket(), 40000, kNoiseMm), offset());
  cloud.normals.clear();
  const AlignmentResult result = align_to_model(cloud, model(), {});
  EXPECT_TRUE(result.converged);
  EXPECT_LT(worst_error_mm(result), 0.01);
}

TEST(Alignment, CovarianceIsWhatRepetitionShows) {
  constexpr int kRuns = 30;
  const Eigen::Vector3d point(60, 0, 2);
  Eigen::Matrix<double, 3, 6> j;
  j << -cross_matrix(point), Eigen::Matrix3d::Identity();
  double squares = 0, stated = 0;
  for (uint32_t seed = 1; seed <= kRuns; ++seed) {
    const AlignmentResult result = align_to_model(mesh_points(bracket(), 3000, kNoiseMm, seed), model(), {});
    squares += (result.cad_from_cloud * point - point).squaredNorm();
    stated += (j * result.covariance * j.transpose()).trace();
  }
  EXPECT_NEAR(std::sqrt(stated / squares), 1, 0.4);
}

TEST(Alignment, PointsOutOfReachDoNotConverge) {
  PointCloud cloud = mesh_points(bracket(), 1000, kNoiseMm);
  for (auto& p : cloud.points) p.x() += 500;
  const AlignmentResult result = align_to_model(cloud, model(), {});
  EXPECT_FALSE(result.converged);
  EXPECT_TRUE(result.cad_from_cloud.isApprox(Pose::Identity()));
}

}  // namespace
}  // namespace gantry
