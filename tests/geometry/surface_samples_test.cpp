#include "gantry/geometry/surface_samples.h"

#include <gtest/gtest.h>

#include "foundation/expect_input_error.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

TEST(SurfaceSamples, AreSpreadByArea) {
  // Faces of 2 x 3, 3 x 5 and 2 x 5, twice each, in triangles of two sizes and all corners.
  const Eigen::Vector3f size(2, 3, 5);
  const PointCloud cloud = sample_surface(box_mesh({0, 0, 0}, size), 60000, 1);
  ASSERT_EQ(cloud.size(), 60000u);
  ASSERT_TRUE(cloud.has_normals());
  Eigen::Vector3d on_face = Eigen::Vector3d::Zero(), middle = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f &p = cloud.points[i], &n = cloud.normals[i];
    Eigen::Index axis = 0;
    EXPECT_NEAR(n.cwiseAbs().maxCoeff(&axis), 1, 1e-6);
    EXPECT_NEAR(p[axis], n[axis] > 0 ? size[axis] : 0, 1e-6);
    ++on_face[axis];
    middle += p.cast<double>() / 60000;
  }
  const Eigen::Vector3d expected = Eigen::Vector3d(15, 10, 6) / 31 * 60000;
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(on_face[axis], expected[axis], 4 * std::sqrt(expected[axis]));
    EXPECT_NEAR(middle[axis], size[axis] / 2, 0.03);
  }
}

TEST(SurfaceSamples, AreTheSameForTheSameSeed) {
  const TriangleMesh mesh = box_mesh({0, 0, 0}, {1, 1, 1});
  EXPECT_EQ(sample_surface(mesh, 100, 7).points, sample_surface(mesh, 100, 7).points);
  EXPECT_NE(sample_surface(mesh, 100, 7).points, sample_surface(mesh, 100, 8).points);
}

TEST(SurfaceSamples, NeedAnArea) {
  TriangleMesh flat;
  flat.vertices = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  flat.triangles = {{0, 1, 2}};
  expect_input_error([&] { sample_surface(flat, 10, 1); }, {"without area"});
  expect_input_error([&] { sample_surface({}, 10, 1); }, {"without area"});
}

}  // namespace
}  // namespace gantry
