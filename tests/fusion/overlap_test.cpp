#include "gantry/fusion/overlap.h"

#include <gtest/gtest.h>

namespace gantry {
namespace {

/// A square of 40 mm whose lower corner lies at (x, 0, z).
ScanSurface square(float x, float z, float normal_z = 1) {
  ScanSurface surface;
  for (int i = 0; i < 80; ++i)
    for (int j = 0; j < 80; ++j) {
      surface.cloud.points.emplace_back(x + 0.25f + 0.5f * i, 0.25f + 0.5f * j, z);
      surface.cloud.normals.emplace_back(0, 0, normal_z);
    }
  return surface;
}

TEST(Overlap, OfASurfaceWithItselfIsAll) {
  EXPECT_DOUBLE_EQ(predicted_overlap(square(0, 1), square(0, 1), 5), 1);
}

TEST(Overlap, IsTheSharedFraction) {
  EXPECT_DOUBLE_EQ(predicted_overlap(square(0, 1), square(20, 1), 5), 0.5);
  EXPECT_DOUBLE_EQ(predicted_overlap(square(20, 1), square(0, 1), 5), 0.5);
  EXPECT_DOUBLE_EQ(predicted_overlap(square(0, 1), square(100, 1), 5), 0);
}

TEST(Overlap, FollowsTheTaggedPoses) {
  ScanSurface moved = square(0, 1);
  moved.part_from_sensor.mean.translation() = Eigen::Vector3d(30, 0, 0);
  EXPECT_DOUBLE_EQ(predicted_overlap(square(0, 1), moved, 5), 0.25);
  EXPECT_DOUBLE_EQ(predicted_overlap(square(30, 1), moved, 5), 1);
}

TEST(Overlap, FacesOfAWallAreNotCommon) {
  EXPECT_DOUBLE_EQ(predicted_overlap(square(0, 1), square(0, 2, -1), 5), 0);
}

}  // namespace
}  // namespace gantry
