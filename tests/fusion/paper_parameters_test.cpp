#include "gantry/fusion/paper_parameters.h"

#include <gtest/gtest.h>

#include <limits>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

std::vector<ScanSurface> scans(size_t points, double spacing_mm) {
  ScanSurface surface;
  surface.cloud.points.resize(points, Eigen::Vector3f::Zero());
  surface.spacing_mm = spacing_mm;
  return {surface};
}

TEST(PaperParameters, FollowThePapersRules) {
  PaperParameters given;
  given.voxel_size_mm = 2;
  given.m = 3;
  given.p = 4;
  const ResolvedParameters used = resolve(given, scans(200000, 0.2));
  EXPECT_TRUE(used.downsample);
  EXPECT_TRUE(used.fixed_distance);
  EXPECT_DOUBLE_EQ(used.max_distance_threshold_mm, 6);
  EXPECT_DOUBLE_EQ(used.edge_prune_threshold_mm, 0.5);
  EXPECT_FALSE(resolve(given, scans(50000, 0.2)).downsample);
}

TEST(PaperParameters, ChosenOnesFollowTheScaleOfTheData) {
  const ResolvedParameters a = resolve({}, scans(200000, 0.2)), b = resolve({}, scans(200000, 0.02));
  EXPECT_NEAR(a.voxel_size_mm, 10 * b.voxel_size_mm, 1e-9);
  EXPECT_GE(a.voxel_size_mm, 0.2);
  EXPECT_FALSE(a.fixed_distance);
  ASSERT_EQ(a.choices.size(), 3u);
  for (const ParameterChoice& choice : a.choices) EXPECT_FALSE(choice.reason.empty());
  EXPECT_DOUBLE_EQ(resolve({}, scans(1000, 0.5)).voxel_size_mm, 0.5);
}

TEST(PaperParameters, WrongOnesAreNamed) {
  const auto refused = [](auto change, const std::string& key) {
    PaperParameters given;
    change(given);
    try {
      resolve(given, scans(200000, 0.2));
      ADD_FAILURE() << key << " was accepted";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(key), std::string::npos) << error.what();
    }
  };
  refused([](auto& g) { g.voxel_size_mm = -1; }, "voxel_size_mm");
  refused([](auto& g) { g.voxel_size_mm = 0.1; }, "voxel_size_mm");
  refused([](auto& g) { g.voxel_size_mm = std::numeric_limits<double>::quiet_NaN(); }, "voxel_size_mm");
  refused([](auto& g) { g.m = 5; }, "m:");
  refused([](auto& g) { g.p = 1; }, "p:");
  refused([](auto& g) { g.m = 2, g.max_distance_threshold_mm = 4; }, "max_distance_threshold_mm");
  refused([](auto& g) { g.edge_prune_threshold_mm = -1; }, "edge_prune_threshold_mm");
}

TEST(PaperParameters, ConfidenceAndDisagreementAreInverse) {
  EXPECT_DOUBLE_EQ(line_process_confidence(0, 4), 1);
  EXPECT_NEAR(disagreement_at_confidence_mm(0.25, 4), 4, 1e-12);
  for (const double d : {0.1, 1.0, 7.0})
    EXPECT_NEAR(disagreement_at_confidence_mm(line_process_confidence(d, 4), 4), d, 1e-9);
  EXPECT_THROW(disagreement_at_confidence_mm(0, 4), InputError);
}

}  // namespace
}  // namespace gantry
