#include "gantry/geometry/signed_distance.h"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "geometry/solids.h"

namespace gantry {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kPointsPerSolid = 20'000;

double squared_distance_to_segment(const Vector3d& p, const Vector3d& a, const Vector3d& b) {
  const double s = std::clamp((p - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
  return (a + s * (b - a) - p).squaredNorm();
}

/// In double, and by another way than the code under test: the plane's distance if the foot is inside,
/// else the nearest of the three sides.
double distance_to_triangle(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  const Vector3d n = (b - a).cross(c - a).normalized();
  if ((b - a).cross(p - a).dot(n) >= 0 && (c - b).cross(p - b).dot(n) >= 0 &&
      (a - c).cross(p - c).dot(n) >= 0)
    return std::abs((p - a).dot(n));
  return std::sqrt(std::min({squared_distance_to_segment(p, a, b), squared_distance_to_segment(p, b, c),
                             squared_distance_to_segment(p, c, a)}));
}

struct Corners {
  Vector3d a, b, c;
};

Corners corners(const TriangleMesh& mesh, size_t t) {
  const Eigen::Vector3i& tri = mesh.triangles[t];
  return {mesh.vertices[tri[0]].cast<double>(), mesh.vertices[tri[1]].cast<double>(),
          mesh.vertices[tri[2]].cast<double>()};
}

/// Winding number: the solid angles of all triangles (van Oosterom and Strackee, 1983) over 4 pi.
bool brute_inside(const TriangleMesh& mesh, const Vector3d& p) {
  double angle = 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    auto [a, b, c] = corners(mesh, t);
    a -= p, b -= p, c -= p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    angle += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return angle > 2 * std::numbers::pi;
}

double brute_distance(const TriangleMesh& mesh, const Vector3d& p) {
  double best = 1e300;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = corners(mesh, t);
    best = std::min(best, distance_to_triangle(p, a, b, c));
  }
  return best;
}

double brute_facing_distance(const TriangleMesh& mesh, const Vector3d& p, const Vector3d& normal,
                             double min_cosine) {
  double best = 1e300;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = corners(mesh, t);
    if ((b - a).cross(c - a).normalized().dot(normal) >= min_cosine)
      best = std::min(best, distance_to_triangle(p, a, b, c));
  }
  return best;
}

/// Points where signs go wrong: around vertices, around edges and above faces, at distances spread
/// evenly over the orders of magnitude from 0.0003 mm to 10 mm.
class NearPoints {
 public:
  explicit NearPoints(const TriangleMesh& mesh) : mesh_(mesh) {}

  Vector3f next() {
    const Eigen::Vector3i& tri = mesh_.triangles[random_() % mesh_.triangles.size()];
    const Vector3f &a = mesh_.vertices[tri[0]], &b = mesh_.vertices[tri[1]], &c = mesh_.vertices[tri[2]];
    Vector3f base = a;
    const auto kind = random_() % 3;
    if (kind >= 1) base += uniform_(random_) * (b - a);
    if (kind == 2) base += uniform_(random_) * (c - base);
    return base + std::pow(10.0f, -3.5f + 4.5f * uniform_(random_)) * direction();
  }
  Vector3f direction() {
    const float x = normal_(random_), y = normal_(random_), z = normal_(random_);
    return Vector3f(x, y, z).normalized();
  }

 private:
  const TriangleMesh& mesh_;
  std::mt19937 random_{3};
  std::normal_distribution<float> normal_;
  std::uniform_real_distribution<float> uniform_;
};

struct Solid {
  const char* name;
  TriangleMesh mesh;
};

class SignedDistanceOf : public ::testing::TestWithParam<Solid> {};

TEST_P(SignedDistanceOf, AgreesWithBruteForceInValueAndSign) {
  // Nearer than this, float coordinates of some tens of mm do not tell the side.
  constexpr double kResolution_mm = 2e-5;
  const TriangleMesh& mesh = GetParam().mesh;
  const SignedDistance signed_distance(mesh);
  NearPoints points(mesh);
  int inside_count = 0, wrong = 0;
  for (int i = 0; i < kPointsPerSolid; ++i) {
    const Vector3f p = points.next();
    const double distance = brute_distance(mesh, p.cast<double>());
    const bool inside = brute_inside(mesh, p.cast<double>());
    const auto value = signed_distance(p, 1000);
    ASSERT_TRUE(value.has_value());
    ASSERT_NEAR(std::abs(value->distance), distance, 1e-4) << p.transpose();
    ASSERT_NEAR((value->closest - p).norm(), distance, 1e-4);
    ASSERT_NEAR(value->normal.norm(), 1, 1e-5);
    inside_count += inside;
    if (distance > kResolution_mm) wrong += (value->distance < 0) != inside;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(inside_count, kPointsPerSolid / 50);
  EXPECT_LT(inside_count, kPointsPerSolid * 9 / 10);
}

TEST_P(SignedDistanceOf, IsTheSameWithSplitVertices) {
  const TriangleMesh& mesh = GetParam().mesh;
  const SignedDistance welded(mesh), split(split_vertices(mesh));
  NearPoints points(mesh);
  for (int i = 0; i < kPointsPerSolid; ++i) {
    const Vector3f p = points.next();
    const auto a = welded(p, 1000), b = split(p, 1000);
    ASSERT_EQ(a->distance, b->distance) << p.transpose();
    ASSERT_EQ(a->triangle, b->triangle);
    ASSERT_LT((a->normal - b->normal).norm(), 1e-5);
  }
}

TEST_P(SignedDistanceOf, FacingQueryIsBruteForceOverTheFacingTriangles) {
  constexpr float kMinCosine = 0.5f;
  const TriangleMesh& mesh = GetParam().mesh;
  const SignedDistance signed_distance(mesh);
  NearPoints points(mesh);
  for (int i = 0; i < kPointsPerSolid / 2; ++i) {
    const Vector3f p = points.next(), n = points.direction();
    bool doubtful = false;  // a face at the very limit of facing
    for (size_t t = 0; t < mesh.triangles.size(); ++t)
      doubtful |= std::abs(mesh.normal(t).dot(n) - kMinCosine) < 1e-4f;
    if (doubtful) continue;
    const double expected = brute_facing_distance(mesh, p.cast<double>(), n.cast<double>(), kMinCosine);
    const auto value = signed_distance(p, n, kMinCosine, 1000);
    ASSERT_EQ(value.has_value(), expected < 1e300);
    if (!value) continue;
    ASSERT_NEAR(std::abs(value->distance), expected, 1e-4);
    ASSERT_GE(mesh.normal(value->triangle).dot(n), kMinCosine);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Solids, SignedDistanceOf,
    ::testing::Values(Solid{"Cube", box_mesh({-20, -20, -20}, {20, 20, 20})},
                      Solid{"Star", star_mesh(15, 40)}, Solid{"UnevenNeedle", uneven_needle_mesh(5, 60, 20)},
                      Solid{"KnifeEdge", wedge_mesh(30, 60, 5 * std::numbers::pi_v<float> / 180)}),
    [](const auto& solid) { return std::string(solid.param.name); });

TEST(SignedDistance, ThePlateKeepsItsTwoFacesApart) {
  // A wall 1 mm thick, bent by up to 0.9 mm: the nearest face is the wrong one, the facing one is right.
  const SignedDistance plate(box_mesh({-50, -50, 0}, {50, 50, 1}));
  for (float bend = -0.9f; bend <= 0.9f; bend += 0.1f) {
    const auto top = plate({7, 9, 1 + bend}, {0, 0, 1}, 0.5f, 5);
    const auto bottom = plate({7, 9, bend}, {0, 0, -1}, 0.5f, 5);
    ASSERT_TRUE(top && bottom);
    EXPECT_NEAR(top->distance, bend, 1e-5);
    EXPECT_NEAR(bottom->distance, -bend, 1e-5);
    EXPECT_NEAR(top->closest.z(), 1, 1e-6);
    EXPECT_NEAR(bottom->closest.z(), 0, 1e-6);
  }
}

TEST(SignedDistance, NothingBeyondTheMaximumDistance) {
  const SignedDistance cube(box_mesh({-20, -20, -20}, {20, 20, 20}));
  EXPECT_FALSE(cube({0, 0, 25}, 4.99f).has_value());
  EXPECT_TRUE(cube({0, 0, 25}, 5.01f).has_value());
  EXPECT_FALSE(cube({0, 0, 25}, {0, 0, 1}, 0.5f, 4.99f).has_value());
}

}  // namespace
}  // namespace gantry
