#include "local_surface.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <functional>

#include "inspection/samples.h"

namespace gantry::internal {
namespace {

constexpr float kSpacingMm = 0.4f;

/// A height over a square of 30 mm about the origin, on a grid, with noise along z and upright normals.
PointCloud height_field(float noise_mm, const std::function<float(float x, float y)>& height,
                        unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0, noise_mm);
  PointCloud cloud;
  for (int i = -37; i <= 37; ++i)
    for (int j = -37; j <= 37; ++j) {
      const float x = kSpacingMm * i, y = kSpacingMm * j;
      add_point(cloud, {x, y, height(x, y) + noise(random)}, {0, 0, 1}, noise_mm);
    }
  return cloud;
}

float flat(float, float) {
  return 0;
}

bool is_inner(const Eigen::Vector3f& p) {
  return std::max(std::abs(p.x()), std::abs(p.y())) < 13;
}

TEST(LocalSurface, NoiseOfAPlaneIsAveragedAwayAndStated) {
  const PointCloud cloud = height_field(0.05f, flat);
  const LocalSurface surface = fit_local_surface(cloud, 1.2, 0);
  EXPECT_NEAR(surface.spacing_mm, kSpacingMm, 0.05);
  double squares = 0, stated = 0, count = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_TRUE(surface.supported[i]);
    EXPECT_EQ(surface.points[i].head<2>(), cloud.points[i].head<2>()) << "moved sideways";
    if (!is_inner(cloud.points[i])) continue;
    squares += std::pow(surface.points[i].z(), 2);
    stated += std::pow(surface.sigma_mm[i], 2);
    ++count;
  }
  // About 29 neighbours: 1 / sqrt(29), and a little more where noise asks for a quadratic.
  EXPECT_LT(std::sqrt(squares / count), 0.05 / 4);
  EXPECT_GT(std::sqrt(squares / count), 0.05 / 8);
  EXPECT_NEAR(std::sqrt(stated / squares), 1, 0.2);
}

TEST(LocalSurface, UncertaintyIsHonestForFewNeighbours) {
  double squares = 0, count = 0;
  for (const unsigned seed : {1u, 2u, 3u}) {
    const PointCloud cloud = height_field(0.05f, flat, seed);
    const LocalSurface surface = fit_local_surface(cloud, 0.01, 0);  // of two spacings: 13 points
    for (size_t i = 0; i < cloud.size(); ++i) {
      if (!is_inner(cloud.points[i]) || !surface.supported[i]) continue;
      squares += std::pow(surface.points[i].z() / surface.sigma_mm[i], 2);
      ++count;
    }
  }
  EXPECT_NEAR(std::sqrt(squares / count), 1, 0.03);
}

TEST(LocalSurface, AveragingReachesAtLeastTwoSpacings) {
  const PointCloud cloud = height_field(0.05f, flat);
  const LocalSurface surface = fit_local_surface(cloud, 0.01, 0);
  double squares = 0, count = 0, supported = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    if (!is_inner(cloud.points[i])) continue;
    squares += std::pow(surface.points[i].z(), 2);
    supported += surface.supported[i];
    ++count;
  }
  EXPECT_GT(supported, 0.995 * count);
  EXPECT_LT(std::sqrt(squares / count), 0.05 / 2);
}

TEST(LocalSurface, TheTopOfABumpIsKept) {
  constexpr float kHeight = 0.5f, kRadius = 2.5f, kAveraging = 1.2f;
  const auto bump = [](float x, float y) {
    const float r = std::hypot(x, y) / kRadius;
    return r < 1 ? kHeight * std::pow(1 - r * r, 2.0f) : 0.0f;
  };
  const PointCloud cloud = height_field(0.01f, bump);
  const LocalSurface surface = fit_local_surface(cloud, kAveraging, 0);
  double mean = 0, count = 0;
  size_t top = 0;
  for (size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.points[i].head<2>().norm() < 1e-3f) top = i;
    if (cloud.points[i].head<2>().norm() > kAveraging) continue;
    mean += cloud.points[i].z();
    ++count;
  }
  EXPECT_LT(mean / count, kHeight - 0.08) << "a plain mean would do as well";
  EXPECT_TRUE(surface.supported[top]);
  EXPECT_NEAR(surface.points[top].z(), kHeight, 0.02);
}

TEST(LocalSurface, StraightRimsAreFlagged) {
  const PointCloud cloud = height_field(0.02f, flat);
  const LocalSurface surface = fit_local_surface(cloud, 1.2, 0);
  for (size_t i = 0; i < cloud.size(); ++i) {
    const float from_rim = 37 * kSpacingMm - cloud.points[i].head<2>().cwiseAbs().maxCoeff();
    if (from_rim < 0.1f) {
      EXPECT_TRUE(surface.rim[i]) << cloud.points[i].transpose();
    } else if (from_rim > 1.25f) {
      EXPECT_FALSE(surface.rim[i]) << cloud.points[i].transpose();
    }
  }
}

TEST(LocalSurface, PointsOnASharpEdgeAreUnsupported) {
  const PointCloud cloud = height_field(0.01f, [](float x, float) { return -std::abs(x); });
  const LocalSurface surface = fit_local_surface(cloud, 1.2, 0);
  for (size_t i = 0; i < cloud.size(); ++i) {
    if (std::abs(cloud.points[i].x()) < 0.1f) {
      EXPECT_FALSE(surface.supported[i]);
    }
    if (std::abs(cloud.points[i].x()) > 1.3f) {
      EXPECT_TRUE(surface.supported[i]);
    }
  }
}

TEST(LocalSurface, LonePointsAreUnsupported) {
  PointCloud cloud = height_field(0.02f, flat);
  const size_t first = cloud.size();
  add_point(cloud, {0, 0, 20}, {0, 0, 1}, 0.02f);
  add_point(cloud, {50, 0, 0}, {0, 0, 1}, 0.02f);
  add_point(cloud, {50.4f, 0, 0}, {0, 0, 1}, 0.02f);
  const LocalSurface surface = fit_local_surface(cloud, 1.2, 0);
  for (size_t i = first; i < cloud.size(); ++i) {
    EXPECT_FALSE(surface.supported[i]);
    EXPECT_EQ(surface.points[i], cloud.points[i]);
  }
}

TEST(LocalSurface, FacesOfAThinWallAreNotMixed) {
  const PointCloud cloud = box_points({-10, -10, -0.4f}, {10, 10, 0}, kSpacingMm, 0.01f);
  const LocalSurface surface = fit_local_surface(cloud, 1.2, 0);
  for (size_t i = 0; i < cloud.size(); ++i) {
    const float side = cloud.normals[i].z();
    if (std::abs(side) > 0.5f) {
      EXPECT_NEAR(surface.points[i].z(), side > 0 ? 0 : -0.4f, 0.03f);
    }
  }
}

TEST(LocalSurface, ScansThatDisagreeAreAveraged) {
  // Two scans, 0.06 mm apart, each far less noisy than that: the systematic part makes them compatible.
  PointCloud cloud = height_field(0.005f, flat);
  for (size_t i = 0; i < cloud.size(); i += 2) cloud.points[i].z() += 0.06f;
  const LocalSurface surface = fit_local_surface(cloud, 1.2, 0.03);
  for (size_t i = 0; i < cloud.size(); ++i) {
    ASSERT_TRUE(surface.supported[i]);
    if (is_inner(cloud.points[i])) {
      EXPECT_NEAR(surface.points[i].z(), 0.03f, 0.012f);
    }
  }
}

}  // namespace
}  // namespace gantry::internal
