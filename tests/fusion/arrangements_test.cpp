#include "joint/arrangements.h"

#include <gtest/gtest.h>

#include <numbers>

#include "fusion/scenes.h"
#include "gantry/fusion/joint.h"
#include "gantry/sim/parts.h"
#include "gantry/sim/views.h"
#include "joint/setup.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

struct Block {
  std::vector<RangeSurface> scans;
  internal::Poses tagged, truth;  ///< part_from_grid
};

/// Eight views of a block that is nearly the same when turned half round, tagged wrongly by 20 to 30 degrees
/// and mm.
Block make_block(uint64_t view_seed, uint64_t seed) {
  const TriangleMesh part = make_prismatic_block();
  const SensorModel model = small_sensor(1200);
  const Eigen::Vector3d centre = part.bounds().center().cast<double>();
  const std::vector<Pose> truth = poisson_disc_views(part, model, 8, view_seed);
  const RayScene scene(part);
  Block block;
  for (size_t i = 0; i < truth.size(); ++i) {
    TaggedScan scan = scan_of(scene, model, truth[i], i, "view" + std::to_string(i));
    scan.part_from_sensor.mean = perturbation(seed, i, centre, 20, 30) * truth[i];
    scan.part_from_sensor.independent = covariance_about(centre, 15, 15 * kDegree);
    block.scans.push_back(make_range_surface(scan, {}));
    block.tagged.push_back(block.scans.back().part_from_grid());
    block.truth.push_back(truth[i] * block.scans.back().sensor_from_grid);
  }
  return block;
}

TEST(Arrangements, TheBestOfABlockIsTheTruth) {
  const Block block = make_block(4, 1);
  const internal::JointProblem problem = internal::make_problem(block.scans, {});
  const std::vector<internal::Arrangement> found = internal::search_arrangements(problem, block.tagged, 4);
  ASSERT_FALSE(found.empty());
  EXPECT_LT(internal::difference_mm(problem, found[0].poses, block.truth), 3);
  EXPECT_TRUE(internal::placed_otherwise(problem, found[0].poses, block.truth).empty());
  for (size_t k = 1; k < found.size(); ++k) EXPECT_LE(found[k].score, found[k - 1].score);
}

TEST(Arrangements, PlacedOtherwiseNamesWhatHasMoved) {
  const Block block = make_block(1, 1);
  const internal::JointProblem problem = internal::make_problem(block.scans, {});
  internal::Poses moved = block.truth;
  for (Pose& pose : moved) pose = Eigen::Translation3d(100, 20, -5) * pose;  // all alike
  EXPECT_TRUE(internal::placed_otherwise(problem, block.truth, moved).empty());
  moved[3] = Eigen::Translation3d(30, 0, 0) * moved[3];
  EXPECT_EQ(internal::placed_otherwise(problem, block.truth, moved), std::vector<size_t>{3});
}

/// Six views of a box, which is the same when turned half round. The tag of one of them is wrong by `turned`
/// about z.
std::vector<RangeSurface> views_of_a_box(double turned_rad, double sigma_rad) {
  const Eigen::Vector3f half(40, 25, 12);
  TriangleMesh box;
  for (int corner = 0; corner < 8; ++corner)
    box.vertices.emplace_back(corner & 1 ? half.x() : -half.x(), corner & 2 ? half.y() : -half.y(),
                              corner & 4 ? half.z() : -half.z());
  box.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                   {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  const RayScene scene(box);
  std::vector<RangeSurface> scans;
  for (const Eigen::Vector3d& from : {Eigen::Vector3d(1, 0.4, 0.9), Eigen::Vector3d(-0.5, 1, 0.8),
                                      Eigen::Vector3d(-0.7, -0.8, 0.9), Eigen::Vector3d(0.8, -0.9, 0.7),
                                      Eigen::Vector3d(0.5, 0.9, -0.8), Eigen::Vector3d(-0.9, -0.6, -0.8)}) {
    TaggedScan scan =
        scan_of(scene, small_sensor(1600), looking_at(500 * from.normalized(), Eigen::Vector3d::Zero()),
                scans.size(), "view" + std::to_string(scans.size()));
    scan.part_from_sensor.independent = covariance_about(Eigen::Vector3d::Zero(), 2, sigma_rad);
    if (scans.size() == 3)
      scan.part_from_sensor.mean.prerotate(Eigen::AngleAxisd(turned_rad, Eigen::Vector3d::UnitZ()));
    scans.push_back(make_range_surface(scan, {}));
  }
  return scans;
}

TEST(Arrangements, AScanThatFitsInTwoPlacesMakesTheResultAmbiguous) {
  // A quarter turn from both of its places.
  const Registration result = register_joint(views_of_a_box(90 * kDegree, 25 * kDegree), {});
  EXPECT_NE(result.reason.find("ambiguous"), std::string::npos) << result.reason;
  EXPECT_NE(result.reason.find("view3"), std::string::npos) << result.reason;
  // Tags that know better leave no doubt.
  EXPECT_EQ(register_joint(views_of_a_box(5 * kDegree, 5 * kDegree), {}).reason, "");
}

}  // namespace
}  // namespace gantry
