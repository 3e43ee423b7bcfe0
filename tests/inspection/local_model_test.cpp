// Surfaces through a few neighbours, and the triangulation in the plane that one of them needs.

#include "distances/local_model.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <random>

#include "distances/delaunay.h"

namespace gantry::internal {
namespace {

using Points = std::vector<Eigen::Vector3d>;

Eigen::Isometry3d somewhere(uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> any(-1, 1);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() =
      Eigen::Quaterniond(any(random), any(random), any(random), any(random)).normalized().toRotationMatrix();
  pose.translation() = 100 * Eigen::Vector3d(any(random), any(random), any(random));
  return pose;
}

TEST(LocalModel, PlaneIsExactOnAPlane) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1, 1);
  for (uint32_t seed = 0; seed < 50; ++seed) {
    const Eigen::Isometry3d pose = somewhere(seed);
    Points points;
    for (int i = 0; i < 6; ++i) points.push_back(pose * Eigen::Vector3d(any(random), 3 * any(random), 0));
    const double height = 5 * any(random);
    const Eigen::Vector3d query = pose * Eigen::Vector3d(any(random), any(random), height);
    for (const LocalModel model : {distance_to_plane, distance_to_quadric})
      EXPECT_NEAR(model(points, query).value(), std::abs(height), 1e-9);
  }
}

TEST(LocalModel, QuadricIsExactOnAQuadricAboutItsNormal) {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const Eigen::Isometry3d pose = somewhere(seed);
    const auto height = [](double x, double y) { return 0.3 * x * x - 0.2 * y * y + 0.1 * x * y; };
    Points points;  // a grid, so that the plane through them is level
    for (int i = -2; i <= 2; ++i)
      for (int j = -2; j <= 2; ++j) points.push_back(pose * Eigen::Vector3d(i, j, height(i, j)));
    for (const double above : {0.0, 0.7, -1.3}) {
      const Eigen::Vector3d query = pose * Eigen::Vector3d(0.4, -0.7, height(0.4, -0.7) + above);
      EXPECT_NEAR(distance_to_quadric(points, query).value(), std::abs(above), 1e-9);
    }
  }
}

TEST(LocalModel, TriangulationIsExactOnItsOwnVerticesAndFaces) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  for (uint32_t seed = 0; seed < 20; ++seed) {
    const Eigen::Isometry3d pose = somewhere(seed);
    Points points;
    for (int i = 0; i < 12; ++i)
      points.push_back(pose * Eigen::Vector3d(3 * any(random), 3 * any(random), 0.4 * any(random)));
    for (const auto& p : points) EXPECT_NEAR(distance_to_triangulation(points, p).value(), 0, 1e-12);
  }
  // A roof of two faces: above a face along its normal, beside the roof to its eaves.
  const Points roof = {{-1, 0, 0}, {-1, 4, 0}, {0, 0, 1}, {0, 4, 1}, {1, 0, 0}, {1, 4, 0}};
  EXPECT_NEAR(distance_to_triangulation(roof, {0.5, 2, 0.5}).value(), 0, 1e-12);
  EXPECT_NEAR(distance_to_triangulation(roof, {1.5, 2, 1.5}).value(), std::sqrt(2), 1e-12);
  EXPECT_NEAR(distance_to_triangulation(roof, {1.5, 2, 0}).value(), 0.5, 1e-12);
  EXPECT_NEAR(distance_to_triangulation(roof, {0, 2, 3}).value(), 2, 1e-12);
}

TEST(LocalModel, PointsInALineMakeNoSurface) {
  Points line;
  for (int i = 0; i < 8; ++i) line.emplace_back(i, 2 * i, -i);
  const Points twins(8, Eigen::Vector3d(1, 2, 3));
  for (const LocalModel model : {distance_to_plane, distance_to_quadric, distance_to_triangulation}) {
    EXPECT_FALSE(model(line, {1, 1, 1}).has_value());
    EXPECT_FALSE(model(twins, {1, 1, 1}).has_value());
  }
  // Two lines: a plane, but no quadric (the square of one coordinate is a constant).
  Points lines;
  for (int i = 0; i < 4; ++i) {
    lines.emplace_back(i, 1, 0);
    lines.emplace_back(i, -1, 0);
  }
  EXPECT_TRUE(distance_to_plane(lines, {1, 1, 1}).has_value());
  EXPECT_FALSE(distance_to_quadric(lines, {1, 1, 1}).has_value());
}

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

double area_of(const std::vector<Eigen::Vector2d>& points, const std::array<int, 3>& t) {
  return std::abs(cross(points[t[1]] - points[t[0]], points[t[2]] - points[t[0]])) / 2;
}

/// Of the convex hull, by gift wrapping.
double hull_area(const std::vector<Eigen::Vector2d>& points) {
  const auto lowest = std::min_element(points.begin(), points.end(), [](const auto& p, const auto& q) {
    return std::pair(p.y(), p.x()) < std::pair(q.y(), q.x());
  });
  Eigen::Vector2d at = *lowest;
  double area = 0;
  do {
    Eigen::Vector2d next = at;
    for (const auto& p : points) {
      const double side = cross(next - at, p - at);
      if (next == at || side < 0 || (side == 0 && (p - at).norm() > (next - at).norm())) next = p;
    }
    area += cross(at, next) / 2;
    at = next;
  } while (at != *lowest);
  return area;
}

TEST(Delaunay, FillsTheHullOnceWithEmptyCircles) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> any(-3, 3);
  for (int trial = 0; trial < 40; ++trial) {
    std::vector<Eigen::Vector2d> points;
    for (int i = 0; i < 4 + trial / 4; ++i) points.emplace_back(any(random), any(random));
    std::vector<std::array<int, 3>> triangles;
    delaunay(points, triangles);
    double area = 0;
    for (const auto& t : triangles) {
      area += area_of(points, t);
      // The centre of the circle through the corners: as far from all three.
      Eigen::Matrix2d m;
      m << (points[t[1]] - points[t[0]]).transpose(), (points[t[2]] - points[t[0]]).transpose();
      const Eigen::Vector2d right(m.row(0).squaredNorm() / 2, m.row(1).squaredNorm() / 2);
      const Eigen::Vector2d centre = points[t[0]] + m.inverse() * right;
      const double radius = (centre - points[t[0]]).norm();
      for (const auto& p : points) EXPECT_GE((p - centre).norm(), radius * (1 - 1e-6));
    }
    EXPECT_NEAR(area, hull_area(points), 1e-9);
  }
}

TEST(Delaunay, TakesOneDiagonalOfEverySquareOfAGrid) {
  std::vector<Eigen::Vector2d> grid;
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 5; ++j) grid.emplace_back(i, j);
  std::vector<std::array<int, 3>> triangles;
  delaunay(grid, triangles);
  EXPECT_EQ(triangles.size(), 32u);
  double area = 0;
  for (const auto& t : triangles) area += area_of(grid, t);
  EXPECT_NEAR(area, 16, 1e-12);
}

}  // namespace
}  // namespace gantry::internal
