#include "gantry/geometry/triangle_mesh.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/solids.h"

namespace gantry {
namespace {

TEST(TriangleMesh, MeasuresOfABox) {
  const TriangleMesh box = box_mesh({-1, -2, -3}, {4, 5, 6});
  EXPECT_NEAR(box.volume(), 5 * 7 * 9, 1e-9);
  EXPECT_NEAR(box.surface_area(), 2 * (5 * 7 + 7 * 9 + 9 * 5), 1e-9);
  EXPECT_EQ(box.bounds().min(), Eigen::Vector3f(-1, -2, -3));
  EXPECT_EQ(box.bounds().max(), Eigen::Vector3f(4, 5, 6));
  Eigen::Vector3d closed = Eigen::Vector3d::Zero();
  for (size_t t = 0; t < box.triangles.size(); ++t) {
    const Eigen::Vector3f n = box.normal(t), corner = box.vertices[box.triangles[t][0]];
    EXPECT_NEAR(n.norm(), 1, 1e-6);
    EXPECT_GT(n.dot(corner - box.bounds().center()), 0) << "a normal points into the material";
    closed += box.area(t) * n.cast<double>();
  }
  EXPECT_LT(closed.norm(), 1e-9);
}

TEST(TriangleMesh, VolumeDoesNotDependOnPlaceAndChangesSignWhenTurnedInsideOut) {
  const TriangleMesh star = star_mesh(10, 30);
  const TriangleMesh moved = transformed(star, pose_from_position_rpy({1000, -2000, 500}, {0.3, 1.0, -2.0}));
  EXPECT_GT(star.volume(), 0);
  EXPECT_NEAR(moved.volume() / star.volume(), 1.0, 1e-4);
  EXPECT_NEAR(moved.surface_area() / star.surface_area(), 1.0, 1e-4);
  TriangleMesh inside_out = star;
  for (auto& t : inside_out.triangles) std::swap(t[0], t[1]);
  EXPECT_NEAR(inside_out.volume(), -star.volume(), 1e-9 * star.volume());
}

TEST(TriangleMesh, DegenerateTriangleHasNoNormalAndNoArea) {
  const TriangleMesh mesh{{{0, 0, 0}, {1, 1, 1}, {2, 2, 2}}, {{0, 1, 2}, {0, 0, 1}}};
  for (size_t t = 0; t < 2; ++t) {
    EXPECT_EQ(mesh.normal(t), Eigen::Vector3f::Zero());
    EXPECT_EQ(mesh.area(t), 0);
  }
}

TEST(TriangleMesh, TinyTrianglesStillHaveAUnitNormal) {
  const TriangleMesh mesh{{{0, 0, 0}, {1e-12f, 0, 0}, {0, 1e-12f, 0}}, {{0, 1, 2}}};
  EXPECT_TRUE(mesh.normal(0).isApprox(Eigen::Vector3f::UnitZ()));
}

TEST(TriangleMesh, MergedKeepsBothShells) {
  const TriangleMesh a = box_mesh({0, 0, 0}, {1, 1, 1}), b = box_mesh({5, 0, 0}, {7, 2, 2});
  const TriangleMesh both = merged(a, b);
  EXPECT_EQ(both.vertices.size(), 16u);
  EXPECT_EQ(both.triangles.size(), 24u);
  EXPECT_NEAR(both.volume(), 1 + 8, 1e-9);
}

}  // namespace
}  // namespace gantry
