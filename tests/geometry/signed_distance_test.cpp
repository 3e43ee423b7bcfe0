#include "gantry/geometry/signed_distance.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>
#include <random>

#include "geometry/brute_distance.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kPointsPerSolid = 20'000, kPointsForSigns = 200'000;

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
  for (int i = 0; i < kPointsForSigns; ++i) {
    const Vector3f p = points.next();
    const double distance = brute_distance(mesh, p.cast<double>());
    const bool inside = brute_inside(mesh, p.cast<double>());
    const auto value = signed_distance(p, 1000);
    ASSERT_TRUE(value.has_value());
    ASSERT_NEAR(std::abs(value->distance), distance, 1e-4) << p.transpose();
    ASSERT_NEAR((value->closest - p).norm(), distance, 1e-4);
    ASSERT_NEAR(value->normal.norm(), 1, 1e-5);
    ASSERT_FALSE(value->at_border);
    inside_count += inside;
    if (distance > kResolution_mm) wrong += (value->distance < 0) != inside;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(inside_count, kPointsForSigns / 50);
  EXPECT_LT(inside_count, kPointsForSigns * 9 / 10);
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

TEST(SignedDistance, OfAnOpenMeshTheBorderIsTold) {
  // A cube without its top: the sides still tell what is inside, and at the rim it is said that they end.
  TriangleMesh cup = box_mesh({-20, -20, -20}, {20, 20, 20});
  std::erase_if(cup.triangles, [&](const Eigen::Vector3i& t) {
    return cup.vertices[t[0]].z() > 0 && cup.vertices[t[1]].z() > 0 && cup.vertices[t[2]].z() > 0;
  });
  ASSERT_EQ(cup.triangles.size(), 10u);
  const SignedDistance distance(cup);
  const auto bottom = distance({0, 0, -18}, 100), side = distance({22, 3, 0}, 100);
  EXPECT_NEAR(bottom->distance, -2, 1e-5);
  EXPECT_NEAR(side->distance, 2, 1e-5);
  EXPECT_FALSE(bottom->at_border);
  EXPECT_FALSE(side->at_border);
  EXPECT_TRUE(distance({19, 3, 25}, 100)->at_border);   // nearest to the rim's edge
  EXPECT_TRUE(distance({25, 25, 25}, 100)->at_border);  // nearest to its corner
  EXPECT_FALSE(distance({25, 25, -25}, 100)->at_border);
}

TEST(SignedDistance, AnEdgeOfThreeTrianglesTakesAllOfThemIntoAccount) {
  // A fin stands on an edge of the cube, in the plane of its front.
  TriangleMesh mesh = box_mesh({0, 0, 0}, {10, 10, 10});
  mesh.vertices.emplace_back(5, 0, 20);
  mesh.triangles.emplace_back(4, 5, 8);
  const SignedDistance distance(mesh);
  EXPECT_NEAR(distance({5, 5, 9}, 100)->distance, -1, 1e-5);
  EXPECT_NEAR(distance({5, 5, 11}, 100)->distance, 1, 1e-5);
  EXPECT_NEAR(distance({5, -1, 10}, 100)->distance, 1, 1e-5);
  EXPECT_NEAR(distance({5, -1, 15}, 100)->distance, 1, 1e-5);  // in front of the fin
  EXPECT_NEAR(distance({5, 1, 15}, 100)->distance, -1, 1e-5);  // behind it: it has no thickness
}

TEST(SignedDistance, ASheetWithBothItsSidesHasNoInside) {
  TriangleMesh sheet{{{0, 0, 0}, {10, 0, 0}, {0, 10, 0}}, {{0, 1, 2}, {0, 2, 1}}};
  const SignedDistance distance(sheet);
  EXPECT_NEAR(distance({-3, 0, 0}, 100)->distance, 3, 1e-5);
  EXPECT_NEAR(distance({-3, 0, 0}, 100)->normal.norm(), 0, 1e-5);
}

/// Turned by any angle, so that nothing cancels exactly.
TriangleMesh turned(TriangleMesh mesh) {
  const Eigen::Matrix3f rotation =
      (Eigen::AngleAxisf(0.7f, Vector3f::UnitX()) * Eigen::AngleAxisf(1.1f, Vector3f::UnitZ())).matrix();
  for (Vector3f& v : mesh.vertices) v = rotation * v;
  return mesh;
}

/// Reflected in the origin, and still facing outwards.
TriangleMesh reflected(TriangleMesh mesh) {
  for (Vector3f& v : mesh.vertices) v = -v;
  for (Eigen::Vector3i& t : mesh.triangles) std::swap(t[0], t[1]);
  return mesh;
}

TEST(SignedDistance, WhereSolidsTouchItIsOutside) {
  // Edge to edge, and tip to tip: the normals there cancel each other, to rounding.
  for (const auto& [solid, other] :
       {std::pair(wedge_mesh(30, 60, 0.4f), wedge_mesh(30, 37.3f, 0.4f)),
        std::pair(uneven_needle_mesh(5, 60, 20), uneven_needle_mesh(4.3f, 51.6f, 20))}) {
    const SignedDistance distance(turned(merged(solid, reflected(other))));
    for (float angle = 0; angle < 2 * std::numbers::pi_v<float>; angle += 0.1f)
      for (const Vector3f& p : {Vector3f(5 * std::cos(angle), 0, 5 * std::sin(angle)),
                                Vector3f(5 * std::cos(angle), 5 * std::sin(angle), 0)}) {
        const Vector3d q = p.cast<double>();
        if (brute_inside(solid, q) || brute_inside(other, -q)) continue;
        const auto value = distance(turned({{p}, {}}).vertices[0], 100);
        if (std::abs(value->distance) < 1e-3f) continue;
        ASSERT_GT(value->distance, 0) << p.transpose();
      }
  }
}

TEST(SignedDistance, ASheetWithBothItsSidesHasNoInsideAtItsCornersEither) {
  TriangleMesh fan{{{0, 0, 0}}, {}};
  for (const float angle : {0.1f, 1.2f, 0.9f, 2.7f})
    fan.vertices.emplace_back(10 * std::cos(angle), 10 * std::sin(angle), 0);
  // In an order in which the sums do not cancel one by one.
  for (const auto& [i, j] : {std::pair(1, 3), std::pair(3, 2), std::pair(2, 4)}) {
    fan.triangles.emplace_back(0, i, j);
    fan.triangles.emplace_back(0, j, i);
  }
  fan = turned(fan);
  const SignedDistance distance(fan);
  const auto at_tip = distance(turned({{{-0.5f, -3, 0.7f}}, {}}).vertices[0], 100);
  EXPECT_GT(at_tip->distance, 3);
  EXPECT_EQ(at_tip->normal, Vector3f::Zero());
}

TEST(SignedDistance, TrianglesListedTwiceCountOnce) {
  const float angle = 40 * std::numbers::pi_v<float> / 180;
  TriangleMesh wedge = wedge_mesh(30, 60, angle);
  const SignedDistance once(wedge);
  const std::vector<Eigen::Vector3i> all = wedge.triangles;
  for (size_t k = 2; k < 4; ++k)  // one face of the edge
    wedge.triangles.emplace_back(all[k][1], all[k][2], all[k][0]);
  const SignedDistance twice(wedge);
  NearPoints points(once.mesh());
  for (int i = 0; i < kPointsPerSolid; ++i) {
    const Vector3f p = points.next();
    const auto a = once(p, 1000), b = twice(p, 1000);
    ASSERT_EQ(a->distance, b->distance) << p.transpose();
    ASSERT_FALSE(b->at_border);
  }
}

TEST(SignedDistance, TessellationsThatMeetInASliverAreClosed) {
  // A cube one of whose edges is split on one side only; a triangle without area bridges it.
  TriangleMesh cube = box_mesh({-20, -20, -20}, {20, 20, 20});
  const auto split = std::find_if(cube.triangles.begin(), cube.triangles.end(), [](const Eigen::Vector3i& t) {
    return (t[0] == 6 && t[1] == 7) || (t[1] == 6 && t[2] == 7) || (t[2] == 6 && t[0] == 7);
  });
  ASSERT_NE(split, cube.triangles.end());
  Eigen::Vector3i t = *split;
  while (t[0] != 6) t = Eigen::Vector3i(t[1], t[2], t[0]);
  cube.triangles.erase(split);
  cube.vertices.emplace_back(0, 20, 20);
  cube.triangles.emplace_back(6, 8, t[2]);
  cube.triangles.emplace_back(8, 7, t[2]);
  EXPECT_TRUE(SignedDistance(cube)({5, 25, 25}, 100)->at_border);
  cube.triangles.emplace_back(6, 7, 8);
  EXPECT_FALSE(SignedDistance(cube)({5, 25, 25}, 100)->at_border);
}

TEST(SignedDistance, TrianglesWithoutAreaDoNotDisturb) {
  TriangleMesh cube = box_mesh({-20, -20, -20}, {20, 20, 20});
  const SignedDistance clean(cube);
  cube.triangles.emplace_back(3, 3, 7);  // a line
  cube.triangles.emplace_back(5, 5, 5);  // a point
  cube.vertices.emplace_back(0, 20, 20);
  cube.triangles.emplace_back(6, 8, 7);  // three points on an edge
  const SignedDistance distance(cube);
  NearPoints points(clean.mesh());
  for (int i = 0; i < kPointsPerSolid; ++i) {
    const Vector3f p = points.next();
    const auto a = clean(p, 1000), b = distance(p, 1000);
    ASSERT_EQ(a->distance, b->distance) << p.transpose();
    ASSERT_EQ(a->triangle, b->triangle);
    ASSERT_FALSE(b->at_border);
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
