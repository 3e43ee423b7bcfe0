#include "joint/chord_errors.h"

#include <gtest/gtest.h>

#include <numbers>

#include "fusion/scenes.h"

namespace gantry {
namespace {

/// The half of a cylinder along x that faces the origin, its axis 500 mm away from it.
TriangleMesh half_cylinder(double radius) {
  constexpr int kSegments = 2000;
  TriangleMesh mesh;
  for (int k = 0; k <= kSegments; ++k) {
    const double angle = std::numbers::pi * (static_cast<double>(k) / kSegments - 0.5);
    for (const float x : {-40.0f, 40.0f})
      mesh.vertices.emplace_back(x, radius * std::sin(angle), 500 - radius * std::cos(angle));
  }
  for (int k = 0; k < kSegments; ++k) {
    const int i = 2 * k;
    mesh.triangles.push_back({i, i + 2, i + 1});
    mesh.triangles.push_back({i + 1, i + 2, i + 3});
  }
  return mesh;
}

struct Gradients {
  Vector6d seen, of_chords;
};

/// At the truth, without noise, all that is left between two scans is what interpolation does.
Gradients gradients_at_the_truth(const TriangleMesh& mesh, const Pose& second) {
  SensorModel sensor = small_sensor();
  sensor.noise_mm = sensor.dropout_probability = 0;
  const RayScene scene(mesh);
  const RangeSurface target = make_range_surface(scan_of(scene, sensor, Pose::Identity(), 1), {}),
                     source = make_range_surface(scan_of(scene, sensor, second, 2), {});
  internal::MatchGates gates;
  gates.stride = 1;
  const Eigen::Vector3d centre(0, 0, 500);
  const Pose relative = target.part_from_grid().inverse() * source.part_from_grid();
  return {internal::match_by_projection(target, source, relative, target.part_from_grid(), centre, gates, 0,
                                        source.height)
              .gradient,
          internal::chord_errors(target, source, relative, target.part_from_grid(), centre, gates)};
}

TEST(ChordErrors, AreWhatInterpolationMissesOfACylinder) {
  Pose second = Pose::Identity();
  second.translation() = Eigen::Vector3d(1.3, 2.7, 0);
  for (const double radius : {12.0, 30.0}) {
    const Gradients at = gradients_at_the_truth(half_cylinder(radius), second);
    ASSERT_GT(std::abs(at.seen[5]), 1);  // mm, summed
    EXPECT_NEAR(at.of_chords[5], at.seen[5], 0.2 * std::abs(at.seen[5])) << radius;
    EXPECT_LT(at.of_chords[5], 0) << "the source lies in front of the target's chords, towards -z";
  }
}

TEST(ChordErrors, AreNoneOfAPlane) {
  TriangleMesh plane;
  plane.vertices = {{-40, -40, 480}, {40, -40, 500}, {40, 40, 520}, {-40, 40, 500}};
  plane.triangles = {{0, 2, 1}, {0, 3, 2}};
  Pose second = Pose::Identity();
  second.translation() = Eigen::Vector3d(1.3, 2.7, 0);
  EXPECT_LT(gradients_at_the_truth(plane, second).of_chords.norm(), 0.3);
}

}  // namespace
}  // namespace gantry
