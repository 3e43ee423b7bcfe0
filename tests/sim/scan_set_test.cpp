#include "gantry/sim/scan_set.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "foundation/expect_input_error.h"
#include "gantry/geometry/surface_index.h"
#include "gantry/sim/views.h"
#include "geometry/solids.h"

namespace gantry {
namespace {

SensorModel tiny_sensor() {
  SensorModel sensor;
  sensor.width = 160;
  sensor.height = 100;
  return sensor;
}

bool same_bits(const Scan& a, const Scan& b) {
  return a.points.size() == b.points.size() &&
         std::memcmp(a.points.data(), b.points.data(), a.points.size() * sizeof(Eigen::Vector3f)) == 0;
}

TEST(ScaledToHeight, HasTheHeightAndItsMiddleAtTheOrigin) {
  const TriangleMesh mesh = box_mesh({10, 20, 30}, {14, 22, 36});
  const TriangleMesh scaled = scaled_to_height(mesh, 150);
  EXPECT_TRUE(scaled.bounds().center().isZero(1e-3f));
  EXPECT_TRUE(scaled.bounds().sizes().isApprox(Eigen::Vector3f(300, 150, 450), 1e-5f));
  EXPECT_EQ(scaled.triangles, mesh.triangles);
}

TEST(ScaledToHeight, RefusesWhatHasNoHeight) {
  const TriangleMesh box = box_mesh({0, 0, 0}, {1, 1, 1});
  for (const double height : {0.0, -150.0, std::nan("")})
    expect_input_error([&] { scaled_to_height(box, height); }, {"height", "positive"});
  TriangleMesh flat = box;
  for (Eigen::Vector3f& vertex : flat.vertices) vertex.y() = 7;
  expect_input_error([&] { scaled_to_height(flat, 150); }, {"height", "no extent along y"});
  expect_input_error([] { scaled_to_height({}, 150); }, {"height", "no extent along y"});
}

TEST(ScanSet, EveryViewIsAScanOfItsOwn) {
  const TriangleMesh part = box_mesh({0, 0, 0}, {90, 70, 50});
  const RayScene scene(part);
  const SurfaceIndex surface(part);
  const std::vector<Pose> truth = poisson_disc_views(part, tiny_sensor(), 3, 1);
  const auto scan = [&](size_t view, uint64_t seed) {
    return scan_of_view(tiny_sensor(), scene, truth, view, seed);
  };
  for (size_t view = 0; view < truth.size(); ++view) {
    const Scan s = scan(view, 1);
    ASSERT_EQ(s.points.size(), 160u * 100u);
    ASSERT_GT(s.valid_count(), 300u);
    // In the sensor's frame, so that the view's pose puts it onto the part; mixed pixels hang in the air.
    size_t off = 0;
    for (size_t i = 0; i < s.points.size(); ++i)
      off += s.valid(i) && !surface.closest((truth[view] * s.points[i].cast<double>()).cast<float>(), 0.5f);
    EXPECT_LT(static_cast<double>(off), 0.3 * static_cast<double>(s.valid_count())) << view;
    EXPECT_TRUE(same_bits(s, scan(view, 1)));
    EXPECT_FALSE(same_bits(s, scan(view, 2)));
  }
  // The number of the view is part of the seed: the same pose twice is two exposures.
  const std::vector<Pose> twice = {truth[0], truth[0]};
  EXPECT_FALSE(same_bits(scan_of_view(tiny_sensor(), scene, twice, 0, 1),
                         scan_of_view(tiny_sensor(), scene, twice, 1, 1)));
}

TEST(ScanSet, WithoutGridLeavesTheMeasuredPointsInTheirOrder) {
  Scan scan;
  scan.width = 3;
  scan.height = 2;
  scan.points = {{1, 2, 3}, invalid_point(), {4, 5, 6}, invalid_point(), invalid_point(), {7, 8, 9}};
  const Scan points = without_grid(scan);
  EXPECT_FALSE(points.organised());
  EXPECT_EQ(points.width, 3);
  EXPECT_EQ(points.points, (std::vector<Eigen::Vector3f>{{1, 2, 3}, {4, 5, 6}, {7, 8, 9}}));
  EXPECT_EQ(without_grid({}).points.size(), 0u);
}

TEST(ScanSet, PerturbedPosesAreOffByTheBandAboutTheCentre) {
  const Eigen::Vector3d centre(60, -20, 400);
  std::vector<Pose> truth(5, Pose::Identity());
  for (size_t i = 0; i < truth.size(); ++i) truth[i].translation().x() = 100.0 * static_cast<double>(i);
  const std::vector<Pose> poses = perturbed_poses(truth, centre, 3, 6, 9);
  ASSERT_EQ(poses.size(), truth.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    const Pose error = poses[i] * truth[i].inverse();
    const double moved_mm = (error * centre - centre).norm();
    EXPECT_GE(moved_mm, 3);
    EXPECT_LE(moved_mm, 6);
    EXPECT_TRUE(error.isApprox(perturbation(9, i, centre, 3, 6), 1e-12));
  }
  expect_input_error([&] { perturbed_poses(truth, centre, 6, 3, 9); }, {"band"});
}

}  // namespace
}  // namespace gantry
