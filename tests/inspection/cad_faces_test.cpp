#include "gantry/inspection/cad_faces.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <random>

#include "gantry/sim/bracket.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

constexpr double kPi = std::numbers::pi;

/// A closed profile of (radius, z) swept about z; `segments` facets all round.
TriangleMesh revolved(const std::vector<Eigen::Vector2d>& profile, int segments) {
  TriangleMesh mesh;
  const auto at = [&](const Eigen::Vector2d& p, int s) {
    const double a = 2 * kPi * (s % segments) / segments;
    mesh.vertices.push_back(Eigen::Vector3d(p.x() * std::cos(a), p.x() * std::sin(a), p.y()).cast<float>());
    return static_cast<int>(mesh.vertices.size()) - 1;
  };
  for (size_t i = 0; i < profile.size(); ++i) {
    const Eigen::Vector2d &p = profile[i], &q = profile[(i + 1) % profile.size()];
    for (int s = 0; s < segments; ++s) {
      const int a = at(p, s), b = at(p, s + 1), c = at(q, s + 1), d = at(q, s);
      if (p.x() > 0) mesh.triangles.emplace_back(a, b, c);
      if (q.x() > 0) mesh.triangles.emplace_back(a, c, d);
    }
  }
  return mesh;
}

std::map<SurfaceKind, int> kinds(const CadFaces& cad) {
  std::map<SurfaceKind, int> count;
  for (const CadFace& face : cad.faces) ++count[face.surface.kind];
  return count;
}

const CadFace* named(const CadFaces& cad, const std::string& words) {
  for (const CadFace& face : cad.faces)
    if (face.words.find(words) != std::string::npos) return &face;
  return nullptr;
}

TEST(CadFaces, ABoxHasSixPlanes) {
  const TriangleMesh box = box_mesh({0, 0, 0}, {30, 20, 10});
  const CadFaces cad = segment_faces(box);
  ASSERT_EQ(cad.faces.size(), 6u);
  EXPECT_EQ(kinds(cad)[SurfaceKind::kPlane], 6);
  EXPECT_NEAR(cad.faces[0].area_mm2, 600, 1e-3);
  EXPECT_EQ(cad.faces[0].name, "plane 1");
  EXPECT_EQ(cad.faces[0].words, "plane, normal -z, through z = 0.0 mm");
  EXPECT_EQ(cad.faces[1].words, "plane, normal +z, through z = 10.0 mm");
  for (const CadFace& face : cad.faces) EXPECT_EQ(face.neighbours.size(), 4u);
  ASSERT_EQ(cad.face_of_triangle.size(), box.triangles.size());
  for (size_t t = 0; t < box.triangles.size(); ++t) {
    const CadFace& face = cad.faces[cad.face_of_triangle[t]];
    EXPECT_TRUE(std::find(face.triangles.begin(), face.triangles.end(), t) != face.triangles.end());
    EXPECT_GT(face.normal.dot(box.normal(t).cast<double>()), 0.999);
  }
}

TEST(CadFaces, ATubeHasAHoleAndABossAsOneFaceEach) {
  // From coarse (22.5 degrees a facet) to fine.
  for (const int segments : {16, 48, 360}) {
    const CadFaces cad = segment_faces(revolved({{4, 0}, {10, 0}, {10, 20}, {4, 20}}, segments));
    ASSERT_EQ(cad.faces.size(), 4u) << segments;
    const CadFace* hole = named(cad, "hole of 8.0 mm along z at x 0.0, y 0.0");
    const CadFace* boss = named(cad, "boss of 20.0 mm along z at x 0.0, y 0.0");
    ASSERT_TRUE(hole && boss) << segments;
    EXPECT_TRUE(hole->surface.hollow);
    EXPECT_FALSE(boss->surface.hollow);
    EXPECT_NEAR(hole->surface.radius_mm, 4, 1e-4);
    EXPECT_NEAR(hole->turn_rad, 2 * kPi, 1e-9);
    // In the hole's air, 1 mm from its wall: outside of the material.
    EXPECT_NEAR(hole->surface.distance({3, 0, 5}), 1, 1e-4);
    EXPECT_NEAR(boss->surface.distance({0, 11, 5}), 1, 1e-4);
    EXPECT_GT(hole->surface.normal_at({3, 0, 5}).dot(Eigen::Vector3d(-1, 0, 0)), 0.999);
  }
}

TEST(CadFaces, AConeAndASphereAreKnown) {
  const CadFaces cone = segment_faces(revolved({{0, 0}, {10, 0}, {5, 10}, {0, 10}}, 64));
  EXPECT_EQ(kinds(cone)[SurfaceKind::kCone], 1);
  EXPECT_EQ(kinds(cone)[SurfaceKind::kPlane], 2);
  const CadFace& face = *std::find_if(cone.faces.begin(), cone.faces.end(),
                                      [](const CadFace& f) { return f.surface.kind == SurfaceKind::kCone; });
  EXPECT_NEAR(face.surface.half_angle_rad, std::atan(0.5), 1e-4);
  EXPECT_LT((face.surface.point - Eigen::Vector3d(0, 0, 20)).norm(), 1e-2);
  EXPECT_NEAR(face.surface.distance({7.5, 0, 5}), 0, 1e-3);

  std::vector<Eigen::Vector2d> half_circle;
  for (int k = 0; k <= 24; ++k)
    half_circle.emplace_back(k % 24 ? 12 * std::sin(kPi * k / 24) : 0, -12 * std::cos(kPi * k / 24));
  const CadFaces sphere = segment_faces(revolved(half_circle, 48));
  ASSERT_EQ(sphere.faces.size(), 1u);
  EXPECT_EQ(sphere.faces[0].words, "sphere of 24.0 mm around (0.0, 0.0, 0.0)");
}

TEST(CadFaces, ARoundedEdgeOfRevolutionIsNoRowOfCones) {
  // A torus between a cylinder and a plane.
  std::vector<Eigen::Vector2d> profile = {{0, 0}, {10, 0}};
  for (int k = 0; k <= 8; ++k)
    profile.emplace_back(8 + 2 * std::cos(kPi / 2 * k / 8), 18 + 2 * std::sin(kPi / 2 * k / 8));
  profile.emplace_back(0, 20);
  const CadFaces cad = segment_faces(revolved(profile, 64));
  auto count = kinds(cad);
  EXPECT_EQ(count[SurfaceKind::kPlane], 2);
  EXPECT_EQ(count[SurfaceKind::kCylinder], 1);
  EXPECT_EQ(count[SurfaceKind::kFreeform], 1);
  EXPECT_EQ(cad.faces.size(), 4u);
}

TEST(CadFaces, TheBracketsFlangesBendsAndBeadAreToldApart) {
  const CadFaces cad = segment_faces(make_bracket());
  auto count = kinds(cad);
  EXPECT_EQ(count[SurfaceKind::kPlane], 10);     // two sides of base and flanges, four cut edges
  EXPECT_EQ(count[SurfaceKind::kCylinder], 11);  // two sides of two bends, seven holes
  EXPECT_EQ(count[SurfaceKind::kFreeform], 2);   // the bead
  EXPECT_EQ(cad.faces.size(), 23u);
  EXPECT_TRUE(named(cad, "hole of 8.0 mm along z at x 20.0, y -27.0"));
  EXPECT_TRUE(named(cad, "hole of 20.0 mm along x at y -14.0, z 36.0"));
  const CadFace* inside = named(cad, "inside rounding of radius 3.0 mm along y");
  ASSERT_TRUE(inside);
  EXPECT_NEAR(inside->area_mm2, 80 * 3 * kPi / 2, 0.5);
  EXPECT_NEAR(inside->turn_rad, kPi / 2, 1e-3);
  double area = 0;
  for (const CadFace& face : cad.faces) area += face.area_mm2;
  EXPECT_NEAR(area, make_bracket().surface_area(), 0.1);
}

TEST(CadFaces, NamesDoNotDependOnTheOrderOfTriangles) {
  TriangleMesh bracket = make_bracket();
  const CadFaces before = segment_faces(bracket);
  std::mt19937 random(3);
  for (size_t i = bracket.triangles.size(); i-- > 1;)
    std::swap(bracket.triangles[i], bracket.triangles[random() % (i + 1)]);
  const CadFaces after = segment_faces(bracket);
  ASSERT_EQ(after.faces.size(), before.faces.size());
  for (size_t f = 0; f < after.faces.size(); ++f) {
    EXPECT_EQ(after.faces[f].name, before.faces[f].name);
    EXPECT_EQ(after.faces[f].words, before.faces[f].words);
    EXPECT_LT((after.faces[f].centre_mm - before.faces[f].centre_mm).norm(), 0.02);
  }
}

TEST(CadFaces, WhatIsNoCadIsFreeform) {
  // A lump: a sphere whose radius changes without any law.
  std::vector<Eigen::Vector2d> half_circle;
  for (int k = 0; k <= 60; ++k)
    half_circle.emplace_back(k % 60 ? 12 * std::sin(kPi * k / 60) : 0, -12 * std::cos(kPi * k / 60));
  TriangleMesh lump = revolved(half_circle, 120);
  for (auto& v : lump.vertices) {
    const double wave = 0.3 * std::sin(0.7 * v.x()) * std::cos(0.5 * v.y() + 1) + 0.2 * std::sin(0.9 * v.z());
    v *= static_cast<float>(1 + wave / 3);
  }
  const CadFaces cad = segment_faces(lump);
  ASSERT_FALSE(cad.faces.empty());
  EXPECT_LE(cad.faces.size(), 3u);
  EXPECT_EQ(cad.faces.back().surface.kind, SurfaceKind::kFreeform);
  EXPECT_GT(cad.faces.back().area_mm2, 0.99 * lump.surface_area());
}

TEST(CadFaces, TrianglesWithoutAreaDoNoHarm) {
  TriangleMesh box = box_mesh({0, 0, 0}, {30, 20, 10});
  box.triangles.emplace_back(0, 0, 1);
  box.triangles.emplace_back(2, 2, 2);
  const CadFaces cad = segment_faces(box);
  EXPECT_EQ(cad.faces.size(), 6u);
  for (const int face : cad.face_of_triangle) {
    EXPECT_GE(face, 0);
    EXPECT_LT(face, 6);
  }
}

}  // namespace
}  // namespace gantry
