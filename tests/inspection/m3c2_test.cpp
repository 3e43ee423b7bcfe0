// M3C2: distance along normals and what it says of its own certainty.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "foundation/expect_input_error.h"
#include "gantry/inspection/distances.h"

namespace gantry {
namespace {

/// Points at random over a square of 10 x 10 mm at height z, with noise along z.
PointCloud noisy_plane(size_t count, double z_mm, double noise_mm, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> side(-5, 5);
  std::normal_distribution<double> height(z_mm, noise_mm);
  PointCloud cloud;
  for (size_t i = 0; i < count; ++i) {
    const float x = side(random), y = side(random);
    cloud.points.emplace_back(x, y, static_cast<float>(height(random)));
  }
  return cloud;
}

size_t middle_point(const PointCloud& cloud) {
  size_t best = 0;
  for (size_t i = 0; i < cloud.size(); ++i)
    if (cloud.points[i].head<2>().norm() < cloud.points[best].head<2>().norm()) best = i;
  return best;
}

TEST(LevelOfDetection, IsTheFormulaOfThePaper) {
  // 1.96 (sqrt(0.3^2 / 9 + 0.4^2 / 16) + 0.05)
  EXPECT_NEAR(level_of_detection_95(0.3, 9, 0.4, 16, 0.05), 1.96 * (std::sqrt(0.01 + 0.01) + 0.05), 1e-12);
}

TEST(M3c2, CleanPlanesAreTheirShiftApart) {
  const PointCloud a = noisy_plane(3000, 0.8, 0, 1);
  const DistanceReference b(noisy_plane(2000, 0, 0, 2));
  const DistanceResult up = compare(a, b, Metric::kM3c2);
  EXPECT_NEAR(up.value, 0.8, 1e-6);
  EXPECT_NEAR(up.summary.min, 0.8, 1e-5);
  EXPECT_NEAR(up.summary.max, 0.8, 1e-5);
  EXPECT_NE(up.note.find("cylinder"), std::string::npos);
  // The normal points up unless the clouds say otherwise.
  PointCloud downwards = a;
  downwards.normals.assign(a.size(), -Eigen::Vector3f::UnitZ());
  const DistanceResult down = compare(downwards, b, Metric::kM3c2);
  EXPECT_NEAR(down.summary.mean, -0.8, 1e-6);
  EXPECT_NEAR(down.value, 0.8, 1e-6);
}

TEST(M3c2, MeasuresAlongTheNormalOfASlope) {
  const Eigen::AngleAxisf tilt(0.6f, Eigen::Vector3f::UnitX());
  PointCloud a = noisy_plane(3000, 0, 0, 3), b = noisy_plane(3000, 0, 0, 4);
  for (auto& p : a.points) p = tilt * p + Eigen::Vector3f(0, 0, 1);
  for (auto& p : b.points) p = tilt * p;
  EXPECT_NEAR(compare(a, DistanceReference(b), Metric::kM3c2).summary.p50, std::cos(0.6), 1e-4);
}

TEST(M3c2, LevelOfDetectionCoversTheTruthNineteenTimesInTwenty) {
  constexpr double kTruth = 0.5;
  DistanceOptions options;
  options.m3c2_normal_diameter_mm = 9;
  options.m3c2_cylinder_diameter_mm = 3;  // some 40 points in either cloud
  options.m3c2_depth_mm = 2;
  size_t covered = 0;
  constexpr size_t kTrials = 300;
  double mean = 0;
  for (uint32_t seed = 0; seed < kTrials; ++seed) {
    const PointCloud a = noisy_plane(500, kTruth, 0.1, 2 * seed);
    const DistanceReference b(noisy_plane(600, 0, 0.2, 2 * seed + 1));
    const size_t i = middle_point(a);
    const DistanceResult r = compare(a, b, Metric::kM3c2, options);
    covered += std::abs(r.distance_mm[i] - kTruth) <= r.lod95_mm[i];
    mean += r.distance_mm[i] / kTrials;
  }
  EXPECT_NEAR(mean, kTruth, 0.005);
  // 285 expected; three standard deviations of a binomial distribution are 11.
  EXPECT_GE(covered, 274u);
  EXPECT_LE(covered, 296u);
}

TEST(M3c2, RegistrationAddsToTheLevelOfDetection) {
  const PointCloud a = noisy_plane(800, 0.2, 0.05, 5);
  const DistanceReference b(noisy_plane(800, 0, 0.05, 6));
  DistanceOptions options;
  const DistanceResult without = compare(a, b, Metric::kM3c2, options);
  options.registration_mm = 0.1;
  const DistanceResult with = compare(a, b, Metric::kM3c2, options);
  for (size_t i = 0; i < a.size(); ++i)
    if (std::isfinite(without.lod95_mm[i])) {
      EXPECT_NEAR(with.lod95_mm[i] - without.lod95_mm[i], 0.196, 1e-5);
    }
}

TEST(M3c2, SaysNothingWhereTheOtherCloudIsMissing) {
  const PointCloud a = noisy_plane(3000, 0.1, 0.01, 7);
  PointCloud half = noisy_plane(3000, 0, 0.01, 8);
  std::erase_if(half.points, [](const auto& p) { return p.x() > 0; });
  DistanceOptions options;
  options.m3c2_cylinder_diameter_mm = 1;
  options.m3c2_depth_mm = 1;
  const DistanceResult r = compare(a, DistanceReference(half), Metric::kM3c2, options);
  for (size_t i = 0; i < a.size(); ++i) {
    if (a.points[i].x() > 0.5f) {
      EXPECT_TRUE(std::isnan(r.distance_mm[i]));
    }
    EXPECT_EQ(std::isnan(r.distance_mm[i]), std::isnan(r.lod95_mm[i]));
  }
  EXPECT_GT(r.summary.count, 1200u);
  EXPECT_LT(r.summary.count, 1800u);
}

TEST(M3c2, RefusesTooFewPointsAndScalesThatCannotBeChosen) {
  const PointCloud three = noisy_plane(3, 0, 0, 9), many = noisy_plane(100, 0, 0, 10);
  expect_input_error([&] { compare(three, DistanceReference(many), Metric::kM3c2); },
                     {"m3c2", "four points", "3 and 100"});
  PointCloud twins;
  twins.points.assign(10, Eigen::Vector3f(1, 2, 3));
  expect_input_error([&] { compare(twins, DistanceReference(twins), Metric::kM3c2); }, {"m3c2", "coincide"});
}

}  // namespace
}  // namespace gantry
