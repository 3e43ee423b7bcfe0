#include "gantry/fusion/sampling.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace gantry {
namespace {

constexpr SamplingStrategy kStrategies[] = {SamplingStrategy::kUniform, SamplingStrategy::kRandom,
                                            SamplingStrategy::kNormalSpace,
                                            SamplingStrategy::kMaximumLeverage};

/// A plate of 10000 points that looks up and a flange of 200 that looks along x.
ScanSurface plate_with_flange() {
  ScanSurface surface;
  for (int i = 0; i < 10200; ++i) {
    const bool plate = i < 10000;
    const int k = plate ? i : i - 10000;
    surface.cloud.points.emplace_back(plate ? 0.5f * (k % 100) : 50.0f,
                                      plate ? 0.5f * (k / 100) : 1.0f * (k / 4), plate ? 0 : 0.5f * (k % 4));
    surface.cloud.normals.emplace_back(plate ? 0 : 1, 0, plate ? 1 : 0);
    surface.cloud.sigma_mm.push_back(0.05f);
    surface.rim.push_back(plate && k % 100 == 0);
  }
  surface.spacing_mm = 0.5;
  return surface;
}

size_t on_flange(const std::vector<uint32_t>& points) {
  return std::count_if(points.begin(), points.end(), [](uint32_t i) { return i >= 10000; });
}

TEST(Sampling, IsTheSameEveryTimeSortedAndOffTheRim) {
  const ScanSurface surface = plate_with_flange();
  for (const SamplingStrategy strategy : kStrategies) {
    const auto a = sample_points(surface, strategy, 500);
    EXPECT_EQ(a, sample_points(surface, strategy, 500)) << to_string(strategy);
    EXPECT_TRUE(std::is_sorted(a.begin(), a.end()));
    EXPECT_EQ(std::adjacent_find(a.begin(), a.end()), a.end());
    EXPECT_LE(a.size(), 500u);
    EXPECT_GE(a.size(), 450u) << to_string(strategy);
    for (const uint32_t i : a) EXPECT_FALSE(surface.rim[i]);
    EXPECT_EQ(sample_points(surface, strategy, 0).size(), 10100u);
  }
}

TEST(Sampling, NormalSpaceAndLeverageSeeTheFlange) {
  const ScanSurface surface = plate_with_flange();
  EXPECT_LT(on_flange(sample_points(surface, SamplingStrategy::kRandom, 300)), 30u);
  EXPECT_GE(on_flange(sample_points(surface, SamplingStrategy::kNormalSpace, 300)), 140u);
  EXPECT_GE(on_flange(sample_points(surface, SamplingStrategy::kMaximumLeverage, 300)), 60u);
}

TEST(Sampling, UniformIsSpreadEvenly) {
  const auto points = sample_points(plate_with_flange(), SamplingStrategy::kUniform, 400);
  size_t quarters[4] = {};
  for (const uint32_t i : points)
    if (i < 10000) ++quarters[(i % 100) / 50 + 2 * (i / 5000)];
  for (const size_t count : quarters) EXPECT_NEAR(static_cast<double>(count), 98, 20);
}

}  // namespace
}  // namespace gantry
