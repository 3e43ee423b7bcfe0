#include <gtest/gtest.h>

#include "gantry/sim/bracket.h"
#include "inspection/alignment_samples.h"

namespace gantry {
namespace {

constexpr int kRuns = 200;

struct Coverage {
  double within_95 = 0;   ///< Fraction of runs whose 95 % region holds the truth.
  double mean_ratio = 0;  ///< Mean chi-square over its degrees of freedom: 1 when stated exactly.
  std::vector<std::string> free_words;  ///< Of the last run.
};

/// Aligns many clouds, each with other noise, that were moved by a known pose.
Coverage coverage_of(const TriangleMesh& cad, const std::function<PointCloud(uint32_t seed)>& draw) {
  const SignedDistance model(cad);
  Coverage coverage;
  for (uint32_t seed = 1; seed <= kRuns; ++seed) {
    const Pose cloud_from_cad =
        turn_about(cad.bounds().center().cast<double>(), {0.05, -0.03, 0.04}, {0.05, -0.08, 0.06});
    const AlignmentResult result = align_to_model(moved(draw(seed), cloud_from_cad), model, {});
    EXPECT_TRUE(result.converged) << "seed " << seed << ": " << result.status;
    const size_t held = 6 - result.free_motions.size();
    const double chi = chi_square(result, cloud_from_cad);
    coverage.within_95 += chi <= chi_square_95(held) ? 1.0 / kRuns : 0.0;
    coverage.mean_ratio += chi / static_cast<double>(held) / kRuns;
    coverage.free_words.clear();
    for (const FreeMotion& motion : result.free_motions) coverage.free_words.push_back(motion.words);
  }
  return coverage;
}

void expect_honest(const Coverage& coverage) {
  std::printf("within 95 %%: %.3f, chi-square / freedoms %.2f\n", coverage.within_95, coverage.mean_ratio);
  // 200 runs: one sigma of the fraction is 1.5 %.
  EXPECT_GT(coverage.within_95, 0.91);
  EXPECT_LT(coverage.within_95, 0.995);
}

TEST(AlignmentCoverage, WhiteNoise) {
  const TriangleMesh bracket = make_bracket();
  const Coverage coverage =
      coverage_of(bracket, [&](uint32_t seed) { return mesh_points(bracket, 2500, 0.02f, seed); });
  expect_honest(coverage);
  EXPECT_TRUE(coverage.free_words.empty());
}

TEST(AlignmentCoverage, NoiseThatNeighboursShare) {
  const TriangleMesh block = box_mesh({0, 0, 0}, {80, 60, 40});
  expect_honest(coverage_of(block, [&](uint32_t seed) {
    PointCloud cloud = mesh_points(block, 2500, 0.01f, seed);
    add_waves(cloud, 0.02, 4, 1000 + seed);
    return cloud;
  }));
}

TEST(AlignmentCoverage, DefectsThatAreMasked) {
  const TriangleMesh block = box_mesh({0, 0, 0}, {80, 60, 40});
  expect_honest(coverage_of(block, [&](uint32_t seed) {
    PointCloud cloud = mesh_points(block, 2500, 0.02f, seed);
    for (size_t i = 0; i < cloud.size(); ++i)
      if (cloud.normals[i].z() > 0.5f && cloud.points[i].x() > 30) cloud.points[i].z() -= 0.4f;
    return cloud;
  }));
}

TEST(AlignmentCoverage, APlaneIsFreeInThreeDirections) {
  const TriangleMesh block = box_mesh({0, 0, 0}, {80, 60, 40});
  const Coverage coverage = coverage_of(block, [&](uint32_t seed) {
    const PointCloud all = box_points({10, 10, 0}, {70, 50, 40}, 1.5f, 0.02f, seed);
    PointCloud top;
    for (size_t i = 0; i < all.size(); ++i)
      if (all.normals[i].z() > 0.5f) add_point(top, all.points[i], all.normals[i], 0.02f);
    return top;
  });
  expect_honest(coverage);
  EXPECT_EQ(coverage.free_words,
            (std::vector<std::string>{"sliding along x", "sliding along y", "turning about z"}));
}

}  // namespace
}  // namespace gantry
