#include "gantry/fusion/merge.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstring>

#include "fusion/scenes.h"

namespace gantry {
namespace {

/// A square of 20 mm at height z with points every 0.5 mm, none on the border of a cell of 1 mm.
ScanSurface square(float z, float sigma_mm, float normal_z = 1) {
  ScanSurface surface;
  for (int i = 0; i < 40; ++i)
    for (int j = 0; j < 40; ++j) {
      surface.cloud.points.emplace_back(0.25f + 0.5f * i, 0.25f + 0.5f * j, z);
      surface.cloud.normals.emplace_back(0, 0, normal_z);
      surface.cloud.sigma_mm.push_back(sigma_mm);
    }
  surface.rim.assign(surface.cloud.size(), 0);
  surface.spacing_mm = 0.5;
  return surface;
}

MergeOptions cells_of(double voxel_mm) {
  MergeOptions options;
  options.voxel_mm = voxel_mm;
  return options;
}

const Pose kHere = Pose::Identity();

TEST(Merge, OffsetPlanesBecomeTheirWeightedMean) {
  // Weights 9 to 1.
  const PointCloud merged =
      merge_surfaces({square(0.4f, 0.02f), square(0.5f, 0.06f)}, {kHere, kHere}, cells_of(1));
  ASSERT_EQ(merged.size(), 400u);
  const double weight = 4 / (0.02 * 0.02) + 4 / (0.06 * 0.06);
  for (size_t i = 0; i < merged.size(); ++i) {
    EXPECT_NEAR(merged.points[i].z(), 0.41, 1e-5);
    EXPECT_NEAR(merged.sigma_mm[i], 1 / std::sqrt(weight), 1e-6);
    EXPECT_LT((merged.normals[i] - Eigen::Vector3f::UnitZ()).norm(), 1e-5f);
  }
}

TEST(Merge, PosesCarryPointsAndNormals) {
  Pose turned = Pose::Identity();
  turned.linear() = rotation_exp({0, 1.5707963267948966, 0});
  turned.translation() = Eigen::Vector3d(3, 0, 0);
  const PointCloud merged = merge_surfaces({square(0.4f, 0.02f)}, {turned}, cells_of(1));
  ASSERT_GT(merged.size(), 0u);
  for (size_t i = 0; i < merged.size(); ++i) {
    EXPECT_NEAR(merged.points[i].x(), 3.4, 1e-5);
    EXPECT_LT((merged.normals[i] - Eigen::Vector3f::UnitX()).norm(), 1e-5f);
  }
}

TEST(Merge, FacesOfAThinWallStayApart) {
  const PointCloud merged =
      merge_surfaces({square(1.4f, 0.02f), square(0.4f, 0.02f, -1)}, {kHere, kHere}, cells_of(2));
  EXPECT_EQ(merged.size(), 200u);
  for (size_t i = 0; i < merged.size(); ++i)
    EXPECT_NEAR(merged.points[i].z(), merged.normals[i].z() > 0 ? 1.4 : 0.4, 1e-5);
}

TEST(Merge, LonePointsAreDropped) {
  ScanSurface surface = square(0.4f, 0.02f);
  surface.cloud.points.emplace_back(5, 5, 9);
  surface.cloud.points.emplace_back(-90, 5, 0.4f);
  for (int k = 0; k < 2; ++k) {
    surface.cloud.normals.emplace_back(0, 0, 1);
    surface.cloud.sigma_mm.push_back(0.02f);
  }
  MergeOptions options = cells_of(1);
  EXPECT_EQ(merge_surfaces({surface}, {kHere}, options).size(), 400u);
  options.min_support = 1;
  EXPECT_EQ(merge_surfaces({surface}, {kHere}, options).size(), 402u);
}

TEST(Merge, CellSizeComesFromTheSpacingUnlessGiven) {
  double used = 0;
  merge_surfaces({square(0.4f, 0.02f)}, {kHere}, {}, &used);
  EXPECT_DOUBLE_EQ(used, 1.1 * 0.5);
  merge_surfaces({square(0.4f, 0.02f)}, {kHere}, cells_of(2), &used);
  EXPECT_DOUBLE_EQ(used, 2);
}

TEST(Merge, ThreadsDoNotChangeTheResult) {
  const RayScene scene(make_bracket());
  std::vector<ScanSurface> surfaces;
  std::vector<Pose> poses;
  for (int k = 0; k < 2; ++k) {
    poses.push_back(bracket_view(k, 0.9));
    surfaces.push_back(preprocess(scan_of(scene, small_sensor(), poses.back(), k), {}));
  }
  std::vector<PointCloud> results;
  for (const size_t threads : {1, 2}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    results.push_back(merge_surfaces(surfaces, poses, {}));
  }
  ASSERT_GT(results[0].size(), 1000u);
  ASSERT_EQ(results[0].size(), results[1].size());
  const size_t bytes = results[0].size() * sizeof(Eigen::Vector3f);
  EXPECT_EQ(std::memcmp(results[0].points.data(), results[1].points.data(), bytes), 0);
  EXPECT_EQ(std::memcmp(results[0].normals.data(), results[1].normals.data(), bytes), 0);
  EXPECT_EQ(results[0].sigma_mm, results[1].sigma_mm);
}

}  // namespace
}  // namespace gantry
