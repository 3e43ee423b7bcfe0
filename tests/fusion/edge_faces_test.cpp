#include <gtest/gtest.h>

#include "fusion/scenes.h"
#include "gantry/fusion/joint.h"
#include "gantry/sim/views.h"
#include "joint/edge_matches.h"

namespace gantry {
namespace {

/// An axis-parallel box with sharp edges about the origin.
TriangleMesh box(const Eigen::Vector3f& half) {
  TriangleMesh mesh;
  for (int corner = 0; corner < 8; ++corner)
    mesh.vertices.emplace_back(corner & 1 ? half.x() : -half.x(), corner & 2 ? half.y() : -half.y(),
                               corner & 4 ? half.z() : -half.z());
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

RangeSurface seen_from(const RayScene& scene, const Eigen::Vector3d& direction, uint64_t number) {
  TaggedScan scan =
      scan_of(scene, small_sensor(960), looking_at(500 * direction.normalized(), Eigen::Vector3d::Zero()),
              number, "view" + std::to_string(number));
  scan.part_from_sensor.independent = covariance_about({0, 0, 0}, 2, 0.02);
  return make_range_surface(scan, {});
}

TEST(EdgesAtFaces, SetASideSeenFromBelowAgainstTheTopFace) {
  const RayScene scene(box({30, 20, 12}));
  const RangeSurface from_above = seen_from(scene, {0.2, -0.6, 0.8}, 1),
                     from_below = seen_from(scene, {-0.15, -0.8, -0.6}, 2);
  ASSERT_GT(from_below.edges.size(), 50u);
  for (const double lifted_mm : {-0.7, 0.0, 0.4})
    for (const double break_mm : {0.0, 0.3}) {
      const Pose lifted = Eigen::Translation3d(0, 0, lifted_mm) * from_below.part_from_grid();
      internal::PairSum sum;
      for (const internal::PairSum& one : internal::match_edges_to_faces(
               from_above, from_below, from_above.part_from_grid().inverse() * lifted,
               from_above.part_from_grid(), Eigen::Vector3d::Zero(), {1, 2, 1, break_mm, 0}))
        sum += one;
      ASSERT_GT(sum.matches, 50u);
      // An edge that is believed to end before the face is brought nearer to it.
      EXPECT_NEAR(-sum.gradient[5] / sum.hessian(5, 5), -(lifted_mm + break_mm), 0.1)
          << lifted_mm << " " << break_mm;
      EXPECT_NEAR(sum.offset / sum.weight, lifted_mm + break_mm, 0.1);
    }
}

TEST(EdgesAtFaces, AreNoneWhereNoFaceIsSeen) {
  const RayScene scene(box({30, 20, 12}));
  const RangeSurface above = seen_from(scene, {0, 0, 1}, 1), below = seen_from(scene, {0, 0, -1}, 2);
  ASSERT_GT(below.edges.size(), 50u);
  size_t matches = 0;
  for (const internal::PairSum& sum :
       internal::match_edges_to_faces(above, below, above.part_from_grid().inverse() * below.part_from_grid(),
                                      above.part_from_grid(), Eigen::Vector3d::Zero(), {1, 2, 1, 0, 0}))
    matches += sum.matches;
  EXPECT_EQ(matches, 0u);
}

TEST(EdgesAtFaces, HoldABracketWhoseHalvesShareOnlyThinSides) {
  // From these viewpoints two groups of scans have nothing in common but the edges of 2 mm walls: without
  // faces at edges one slides against the other, by millimetres.
  const TriangleMesh part = make_bracket();
  const Eigen::Vector3d centre = part.bounds().center().cast<double>();
  const SensorModel model = small_sensor(1920);
  const std::vector<Pose> truth = poisson_disc_views(part, model, 8, 5);
  const RayScene scene(part);
  std::vector<RangeSurface> scans;
  for (size_t i = 0; i < truth.size(); ++i) {
    TaggedScan scan = scan_of(scene, model, truth[i], i, "view" + std::to_string(i));
    scan.part_from_sensor.mean = perturbation(3, i, centre, 1, 3) * truth[i];
    scan.part_from_sensor.independent = covariance_about(centre, 3, 0.05);
    scans.push_back(make_range_surface(scan, {}));
  }
  const Registration result = register_joint(scans, {});
  EXPECT_EQ(result.reason, "");
  for (size_t i = 1; i < scans.size(); ++i)
    EXPECT_LT((truth[0] * result.part_from_sensor[0].mean.inverse() * result.part_from_sensor[i].mean *
                   (truth[i].inverse() * centre) -
               centre)
                  .norm(),
              0.03)
        << i;
}

TEST(EdgesAtFaces, DoNotMakeABareBlockSure) {
  // All its edges could be broken, and the block as much larger: nothing tells.
  const RayScene scene(box({35, 25, 9}));
  std::vector<RangeSurface> scans;
  uint64_t number = 0;
  for (const double z : {0.7, -0.7})
    for (const Eigen::Vector2d& side : {Eigen::Vector2d(0.7, 0.5), Eigen::Vector2d(-0.6, -0.6)})
      scans.push_back(seen_from(scene, {side.x(), side.y(), z}, ++number));
  EXPECT_NE(register_joint(scans, {}).reason, "");
}

}  // namespace
}  // namespace gantry
