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

}  // namespace
}  // namespace gantry
