#include "gantry/fusion/voxel_grid.h"

#include <gtest/gtest.h>

#include <limits>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

void add(ScanSurface& surface, const Eigen::Vector3f& point, const Eigen::Vector3f& normal,
         float sigma = 0.1f) {
  surface.cloud.points.push_back(point);
  surface.cloud.normals.push_back(normal);
  surface.cloud.sigma_mm.push_back(sigma);
  surface.rim.push_back(0);
}

TEST(VoxelGrid, PointsOfACellBecomeTheirAverage) {
  ScanSurface surface;
  add(surface, {0, 0, 0}, {0, 0, 1});
  add(surface, {0.5f, 0, 0.2f}, {0, 0, 1});
  add(surface, {5, 0, 0}, {0, 0, 1});
  const ScanSurface out = voxel_downsample(surface, 1);
  ASSERT_EQ(out.cloud.size(), 2u);
  EXPECT_TRUE(out.cloud.points[0].isApprox(Eigen::Vector3f(0.25f, 0, 0.1f), 1e-5f));
  EXPECT_NEAR(out.cloud.sigma_mm[0], 0.1 / std::sqrt(2.0), 1e-6);
  EXPECT_DOUBLE_EQ(out.spacing_mm, 1);
}

TEST(VoxelGrid, TheMoreCertainPointWeighsMore) {
  ScanSurface surface;
  add(surface, {0, 0, 0}, {0, 0, 1}, 0.1f);
  add(surface, {0, 0, 0.3f}, {0, 0, 1}, 0.2f);
  EXPECT_NEAR(voxel_downsample(surface, 1).cloud.points[0].z(), 0.06, 1e-5);
}

TEST(VoxelGrid, FacesOfAWallStayApart) {
  ScanSurface surface;
  add(surface, {0, 0, 0}, {0, 0, -1});
  add(surface, {0, 0, 0.5f}, {0, 0, 1});
  EXPECT_EQ(voxel_downsample(surface, 2).cloud.size(), 2u);
}

TEST(VoxelGrid, SizesThatCannotBeAreRejected) {
  ScanSurface surface;
  add(surface, {0, 0, 0}, {0, 0, 1});
  add(surface, {100, 0, 0}, {0, 0, 1});
  for (const double bad : {0.0, -1.0, 1e-6, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(voxel_downsample(surface, bad), InputError) << bad;
}

}  // namespace
}  // namespace gantry
