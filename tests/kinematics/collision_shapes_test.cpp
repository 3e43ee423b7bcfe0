#include "gantry/kinematics/collision_shapes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "foundation/expect_input_error.h"

namespace gantry {
namespace {

/// Whether every triangle has the centre behind it: for a convex mesh around the origin, all face outwards.
void expect_convex_and_outwards(const TriangleMesh& mesh) {
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Eigen::Vector3f corner = mesh.vertices[static_cast<size_t>(mesh.triangles[t][0])];
    const Eigen::Vector3f normal = mesh.normal(t);
    for (const Eigen::Vector3f& vertex : mesh.vertices)
      ASSERT_LE(normal.dot(vertex - corner), 1e-3f * (1 + vertex.norm())) << "triangle " << t;
  }
}

double inscribed(const TriangleMesh& mesh) {
  double least = 1e9;
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    least = std::min(
        least,
        static_cast<double>(mesh.normal(t).dot(mesh.vertices[static_cast<size_t>(mesh.triangles[t][0])])));
  return least;
}

TEST(CollisionShapes, BoxHasItsSizeAndVolume) {
  const TriangleMesh box = box_mesh({10, 20, 30});
  EXPECT_NEAR(box.volume(), 6000, 1e-3);
  EXPECT_EQ(box.bounds().sizes(), Eigen::Vector3f(10, 20, 30));
  expect_convex_and_outwards(box);
}

TEST(CollisionShapes, RoundShapesHoldWhatTheyStandForAndLittleMore) {
  const TriangleMesh cylinder = cylinder_mesh(50, 20);
  expect_convex_and_outwards(cylinder);
  EXPECT_FLOAT_EQ(cylinder.bounds().sizes().z(), 20);
  EXPECT_GE(cylinder.volume(), std::numbers::pi * 2500 * 20);
  EXPECT_LE(cylinder.volume(), std::numbers::pi * 2500 * 20 * 1.004);
  for (const Eigen::Vector3f& vertex : cylinder.vertices) EXPECT_LE(vertex.head<2>().norm(), 50 * 1.005);
  const TriangleMesh sphere = sphere_mesh(50);
  expect_convex_and_outwards(sphere);
  EXPECT_GE(inscribed(sphere), 50 - 1e-3);
  for (const Eigen::Vector3f& vertex : sphere.vertices) EXPECT_LE(vertex.norm(), 50 * 1.02);
}

TEST(CollisionShapes, ConvexHullHoldsEveryVertexAndOnlyThose) {
  std::mt19937_64 random(5);
  std::normal_distribution<float> gauss;
  for (int round = 0; round < 20; ++round) {
    TriangleMesh mesh;
    for (int k = 0; k < 300; ++k)
      mesh.vertices.push_back({30 * gauss(random), 20 * gauss(random), 5 * gauss(random)});
    for (int k = 0; k + 2 < 300; k += 3) mesh.triangles.push_back({k, k + 1, k + 2});
    const TriangleMesh hull = convex_hull(mesh);
    EXPECT_LT(hull.vertices.size(), mesh.vertices.size());
    TriangleMesh both = hull;  // the hull's planes against every vertex of the mesh
    both.vertices.insert(both.vertices.end(), mesh.vertices.begin(), mesh.vertices.end());
    expect_convex_and_outwards(both);
    EXPECT_GT(hull.volume(), 0);
    EXPECT_EQ(hull.triangles.size(), 2 * hull.vertices.size() - 4) << "Euler: closed, of one piece";
  }
}

TEST(CollisionShapes, ConvexHullOfACubeCutsItsSquaresInTwo) {
  const TriangleMesh hull = convex_hull(box_mesh({10, 20, 30}));
  EXPECT_EQ(hull.vertices.size(), 8u);
  EXPECT_EQ(hull.triangles.size(), 12u);
  EXPECT_NEAR(hull.volume(), 6000, 1e-3);
}

TEST(CollisionShapes, BoundingBoxStaysWhereTheMeshIs) {
  TriangleMesh mesh = cylinder_mesh(10, 40);
  for (auto& vertex : mesh.vertices) vertex += Eigen::Vector3f(100, 0, 7);
  EXPECT_TRUE(bounding_box_mesh(mesh).bounds().isApprox(mesh.bounds(), 1e-6f));
}

TEST(CollisionShapes, WhatIsNoSolidIsRefused) {
  expect_input_error([] { box_mesh({1, 0, 1}); }, {"positive"});
  expect_input_error([] { cylinder_mesh(-1, 1); }, {"radius"});
  expect_input_error([] { cylinder_mesh(1, std::nan("")); }, {"height"});
  expect_input_error([] { sphere_mesh(0); }, {"radius"});
  TriangleMesh flat;
  flat.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  flat.triangles = {{0, 1, 2}, {1, 3, 2}};
  expect_input_error([&] { convex_hull(flat); }, {"flat"});
  expect_input_error([] { convex_hull({}); }, {"flat"});
}

}  // namespace
}  // namespace gantry
