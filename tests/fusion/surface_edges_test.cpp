#include <gtest/gtest.h>

#include "fusion/scenes.h"
#include "gantry/fusion/joint.h"
#include "gantry/fusion/range_surface.h"
#include "joint/edge_matches.h"

namespace gantry {
namespace {

/// A rectangle in the plane z = `depth`, facing the sensor at the origin.
TriangleMesh rectangle(float half_width, float half_height, float depth) {
  TriangleMesh mesh;
  mesh.vertices = {{-half_width, -half_height, depth},
                   {half_width, -half_height, depth},
                   {half_width, half_height, depth},
                   {-half_width, half_height, depth}};
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}};
  return mesh;
}

TriangleMesh both(TriangleMesh a, const TriangleMesh& b) {
  const auto first = static_cast<int>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const Eigen::Vector3i& t : b.triangles) a.triangles.push_back(t + Eigen::Vector3i::Constant(first));
  return a;
}

TriangleMesh sphere(double radius, double depth) {
  constexpr int kRings = 90, kSegments = 180;
  TriangleMesh mesh;
  for (int ring = 0; ring <= kRings; ++ring)
    for (int k = 0; k < kSegments; ++k) {
      const double theta = M_PI * ring / kRings, phi = 2 * M_PI * k / kSegments;
      mesh.vertices.emplace_back(static_cast<float>(radius * std::sin(theta) * std::cos(phi)),
                                 static_cast<float>(radius * std::sin(theta) * std::sin(phi)),
                                 static_cast<float>(depth + radius * std::cos(theta)));
    }
  for (int ring = 0; ring < kRings; ++ring)
    for (int k = 0; k < kSegments; ++k) {
      const int a = ring * kSegments + k, b = ring * kSegments + (k + 1) % kSegments;
      mesh.triangles.emplace_back(a, a + kSegments, b);
      mesh.triangles.emplace_back(b, a + kSegments, b + kSegments);
    }
  return mesh;
}

/// The mesh as seen by a sensor that is turned about its middle at 500 mm, and rolled a little: edges along
/// rows of pixels would all be wrong by the same fraction of one.
RangeSurface surface_of(const TriangleMesh& mesh, double tilt_rad, uint64_t number = 1,
                        const PreprocessOptions& options = {}) {
  const RayScene scene(mesh);
  const Eigen::Vector3d middle(0, 0, 500);
  Pose pose = Pose::Identity();
  pose.linear() = rotation_exp({0.4 * tilt_rad, tilt_rad, 0}) * rotation_exp({0, 0, 0.15});
  pose.translation() = middle - pose.linear() * middle;
  return make_range_surface(scan_of(scene, small_sensor(960), pose, number), options);
}

class EdgesOfAPlate : public testing::TestWithParam<double> {};

TEST_P(EdgesOfAPlate, LieWhereItEnds) {
  const RangeSurface s = surface_of(rectangle(40, 25, 500), GetParam());
  ASSERT_GT(s.edges.size(), 300u);
  double bias = 0, worst = 0;
  for (const SurfaceEdge& edge : s.edges) {
    const Pose pose = s.part_from_grid();
    const Eigen::Vector3d p = pose * edge.point.cast<double>(),
                          out = pose.linear() * edge.outwards.cast<double>();
    EXPECT_NEAR(edge.normal.dot(edge.outwards), 0, 1e-4);
    EXPECT_NEAR(edge.outwards.norm(), 1, 1e-4);
    EXPECT_NEAR(p.z(), 500, 0.3);
    if (std::abs(p.x()) > 37 && std::abs(p.y()) > 22) continue;  // corners are no straight lines
    const int axis = std::abs(out.x()) > std::abs(out.y()) ? 0 : 1;
    EXPECT_GT(std::abs(out[axis]), 0.93);
    const double beyond = p[axis] * (out[axis] > 0 ? 1 : -1) - (axis == 0 ? 40 : 25);
    bias += beyond / static_cast<double>(s.edges.size());
    worst = std::max(worst, std::abs(beyond));
  }
  EXPECT_LT(std::abs(bias), 0.2 * s.spacing_mm);
  EXPECT_LT(worst, 1.2 * s.spacing_mm / std::cos(GetParam()));
}

INSTANTIATE_TEST_SUITE_P(SeenFrom, EdgesOfAPlate, testing::Values(0.0, 0.5, 0.9));

TEST(SurfaceEdges, ASmoothSilhouetteIsNone) {
  EXPECT_LT(surface_of(sphere(40, 500), 0).edges.size(), 10u);
}

TEST(SurfaceEdges, SeenAlmostEdgeOnASurfaceMayEndForOtherReasons) {
  EXPECT_EQ(surface_of(rectangle(40, 25, 500), 1.07).edges.size(), 0u);
}

TEST(SurfaceEdges, WhatSomethingInFrontHidesDoesNotEndThere) {
  const RangeSurface s = surface_of(both(rectangle(60, 40, 520), rectangle(15, 15, 480)), 0);
  size_t near = 0, far = 0, false_ends = 0;
  for (const SurfaceEdge& edge : s.edges) {
    ++(edge.point.z() < 500 ? near : far);
    false_ends += edge.point.z() > 500 && std::abs(edge.point.x()) < 55 && std::abs(edge.point.y()) < 35;
  }
  EXPECT_GT(near, 50u);
  EXPECT_GT(far, 200u);
  // The two ends of the projector's shadow are not told from a hole's.
  EXPECT_LT(false_ends, far / 8);
}

TEST(SurfaceEdges, NeitherTheImageNorTheCropBoxEndsASurface) {
  EXPECT_EQ(surface_of(rectangle(600, 400, 500), 0).edges.size(), 0u);
  PreprocessOptions options;
  options.crop_part_mm = Eigen::AlignedBox3d(Eigen::Vector3d(-20, -15, 400), Eigen::Vector3d(20, 15, 600));
  EXPECT_EQ(surface_of(rectangle(40, 25, 500), 0, 1, options).edges.size(), 0u);
}

TEST(SurfaceEdges, SpecksWithoutDataAreNotTaken) {
  TaggedScan scan = scan_of(RayScene(rectangle(60, 40, 500)), small_sensor(960), Pose::Identity(), 1);
  std::mt19937 random(1);
  for (size_t i = 0; i < scan.scan.points.size(); ++i)
    if (random() % 50 == 0) scan.scan.points[i] = invalid_point();
  const RangeSurface s = make_range_surface(scan, {});
  for (const SurfaceEdge& edge : s.edges)
    EXPECT_TRUE(std::abs(edge.point.x()) > 58 || std::abs(edge.point.y()) > 38);
}

TEST(SurfaceEdges, TurnedOverTheyStayAtTheSurface) {
  RangeSurface s = surface_of(rectangle(40, 25, 500), 0.3);
  s.rays.central = false;  // only such scans are turned over; the map of pixels does not matter here
  const std::vector<SurfaceEdge> before = s.edges;
  const Pose pose = s.sensor_from_grid;
  turn_over(s);
  ASSERT_EQ(s.edges.size(), before.size());
  for (size_t k = 0; k < before.size(); ++k) {
    const SurfaceEdge& edge = s.edges[k];
    EXPECT_LT((s.sensor_from_grid * edge.point.cast<double>() - pose * before[k].point.cast<double>()).norm(),
              1e-3);
    EXPECT_LT((s.sensor_from_grid.linear() * edge.normal.cast<double>() +
               pose.linear() * before[k].normal.cast<double>())
                  .norm(),
              1e-5);
    EXPECT_LT((s.sensor_from_grid.linear() * edge.outwards.cast<double>() -
               pose.linear() * before[k].outwards.cast<double>())
                  .norm(),
              1e-5);
  }
}

TEST(EdgeMatches, PullAShiftedPlateBack) {
  const RangeSurface target = surface_of(rectangle(40, 25, 500), 0.2, 1),
                     source = surface_of(rectangle(40, 25, 500), -0.3, 2);
  const internal::EdgeIndex index(target);
  const Eigen::Vector3d centre(0, 0, 500), shift(0.3, -0.2, 0);
  const Pose wrong = Eigen::Translation3d(shift) * source.part_from_grid();
  internal::PairSum sum;
  for (const internal::PairSum& one :
       match_edges(target, index, source, target.part_from_grid().inverse() * wrong, target.part_from_grid(),
                   centre, {1, 2, 1}))
    sum += one;
  EXPECT_GT(sum.matches, 200u);
  // Residuals grow with the error, so the step that takes them away is its opposite.
  const Eigen::Matrix3d in_plane = sum.hessian.bottomRightCorner<3, 3>();
  const Eigen::Vector2d step = -in_plane.topLeftCorner<2, 2>().ldlt().solve(sum.gradient.segment<2>(3));
  EXPECT_LT((step + shift.head<2>()).norm(), 0.1);
}

TEST(EdgeMatches, AFlatPlateDoesNotSlide) {
  std::vector<RangeSurface> scans;
  for (const double tilt : {0.0, 0.4, -0.5}) {
    RangeSurface s = surface_of(rectangle(40, 25, 500), tilt, static_cast<uint64_t>(10 * tilt + 20));
    s.part_from_sensor.independent = covariance_about({0, 0, 500}, 2, 0.02);
    scans.push_back(std::move(s));
  }
  std::vector<Pose> truth;
  for (const RangeSurface& s : scans) truth.push_back(s.part_from_sensor.mean);
  scans[1].part_from_sensor.mean = Eigen::Translation3d(0.9, -0.5, 0.3) * truth[1];
  scans[2].part_from_sensor.mean = Eigen::Translation3d(-0.6, 0.7, -0.2) * truth[2];
  const Registration result = register_joint(scans, {});
  EXPECT_EQ(result.reason, "");
  for (size_t i = 1; i < 3; ++i) {
    const Eigen::Vector3d middle = truth[i].inverse() * Eigen::Vector3d(0, 0, 500);
    EXPECT_LT(
        (truth[0] * result.part_from_sensor[0].mean.inverse() * result.part_from_sensor[i].mean * middle -
         truth[i] * middle)
            .norm(),
        0.06);
  }
}

}  // namespace
}  // namespace gantry
