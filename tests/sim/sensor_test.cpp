#include "gantry/sim/sensor.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <numbers>

namespace gantry {
namespace {

/// Small and free of every error; tests switch on the one they look at.
SensorModel ideal_sensor(int width = 120, int height = 80) {
  SensorModel m;
  m.width = width;
  m.height = height;
  m.projector_offset_mm = 0;
  m.noise_mm = 0;
  m.mixed_pixel_probability = 0;
  m.dropout_probability = 0;
  return m;
}

/// A rectangle at (0, 0, z), seen by a sensor at the origin that looks along z, turned about the y axis.
TriangleMesh plate(double half_x, double half_y, double z, double turn_rad = 0, double x = 0) {
  TriangleMesh mesh;
  const Eigen::Matrix3d turn = rotation_exp({0, turn_rad, 0});
  for (const auto& [u, v] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}})
    mesh.vertices.push_back(
        (turn * Eigen::Vector3d(u * half_x, v * half_y, 0) + Eigen::Vector3d(x, 0, z)).cast<float>());
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}};  // facing the sensor
  return mesh;
}

Eigen::Vector3d ray(const SensorModel& m, int column, int row) {
  return Eigen::Vector3d((column - 0.5 * (m.width - 1)) * 2 * std::tan(m.horizontal_fov_rad / 2) / m.width,
                         (row - 0.5 * (m.height - 1)) * 2 * std::tan(m.vertical_fov_rad / 2) / m.height, 1)
      .normalized();
}

Scan trace(const SensorModel& m, const TriangleMesh& mesh, uint64_t seed = 1, uint64_t number = 0,
           const Pose& pose = Pose::Identity()) {
  return trace_scan(m, RayScene(mesh), pose, pose, seed, number);
}

bool same_bytes(const Scan& a, const Scan& b) {
  return a.points.size() == b.points.size() &&
         std::memcmp(a.points.data(), b.points.data(), a.points.size() * sizeof(a.points[0])) == 0;
}

TEST(Sensor, DistortionIsSmoothAndTheSameInEveryScan) {
  constexpr double kRms = 0.02;
  double squares = 0;
  size_t count = 0;
  for (uint64_t sensor = 1; sensor <= 30; ++sensor) {
    SensorModel m = ideal_sensor(60, 40);
    m.distortion_mm = kRms;
    m.distortion_seed = sensor;
    for (const double distance : {380.0, 500.0, 660.0}) {
      const TriangleMesh wall = plate(2000, 2000, distance);
      const Scan scan = trace(m, wall, 1, 0);
      EXPECT_TRUE(same_bytes(scan, trace(m, wall, 2, 1)));  // no noise, and nothing that changes
      const auto error = [&](int column, int row) {
        const Eigen::Vector3d r = ray(m, column, row);
        return scan.points[scan.index(column, row)].cast<double>().norm() - distance / r.z();
      };
      for (int row = 0; row < m.height; ++row)
        for (int column = 0; column < m.width; ++column) {
          squares += error(column, row) * error(column, row);
          ++count;
          // A wave takes the volume's width at the least: pi / 30 of its amplitude from pixel to pixel.
          if (column > 0) {
            ASSERT_LT(std::abs(error(column, row) - error(column - 1, row)), 0.25 * 4 * kRms);
          }
        }
    }
  }
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(count)), kRms, 0.15 * kRms);
  // Another sensor errs otherwise.
  SensorModel one = ideal_sensor(), other = one;
  one.distortion_mm = other.distortion_mm = kRms;
  other.distortion_seed = 2;
  EXPECT_FALSE(same_bytes(trace(one, plate(2000, 2000, 500)), trace(other, plate(2000, 2000, 500))));
}

TEST(Sensor, WithoutNoiseItMeasuresThePlane) {
  const SensorModel m = ideal_sensor();
  for (const double turn : {0.0, 0.5, -0.9}) {
    const Scan scan = trace(m, plate(2000, 2000, 500, turn));
    const Eigen::Vector3d normal(-std::sin(turn), 0, -std::cos(turn));
    ASSERT_EQ(scan.width, m.width);
    ASSERT_EQ(scan.height, m.height);
    for (int row = 0; row < m.height; ++row) {
      for (int column = 0; column < m.width; ++column) {
        const Eigen::Vector3d r = ray(m, column, row);
        const Eigen::Vector3d truth = r * (normal.z() * 500 / normal.dot(r));
        const size_t i = scan.index(column, row);
        const bool in_range = truth.z() > 350 && truth.z() < 700;
        if (std::abs(truth.z() - 350) < 0.01 || std::abs(truth.z() - 700) < 0.01) continue;
        // Beyond 60 degrees pixels drop out.
        if (-normal.dot(r) < 0.5) continue;
        ASSERT_EQ(scan.valid(i), in_range) << column << "," << row;
        if (in_range) {
          ASSERT_LT((scan.points[i].cast<double>() - truth).norm(), 1e-3);
        }
      }
    }
  }
}

TEST(Sensor, ThePoseIsThatOfTheSensorInTheScene) {
  const SensorModel m = ideal_sensor();
  const Pose pose = pose_from_position_rpy({30, -200, 75}, {0.4, -0.3, 2.0});
  const Scan here = trace(m, plate(90, 50, 500, 0.4));
  const Scan there = trace(m, transformed(plate(90, 50, 500, 0.4), pose), 1, 0, pose);
  size_t compared = 0;
  for (size_t i = 0; i < here.points.size(); ++i) {
    if (!here.valid(i) || !there.valid(i)) continue;
    ++compared;
    ASSERT_LT((here.points[i] - there.points[i]).norm(), 2e-3f);
  }
  EXPECT_GT(compared, 1000u);
  EXPECT_LE(std::max(here.valid_count(), there.valid_count()) - compared, 4u) << "on the plate's edge only";
}

TEST(Sensor, MotionDuringExposureShearsTheScan) {
  const SensorModel m = ideal_sensor();
  Pose end = Pose::Identity();
  end.translation().z() = 10;  // towards the plane
  const Scan scan = trace_scan(m, RayScene(plate(2000, 2000, 500)), Pose::Identity(), end, 1, 0);
  for (int row = 0; row < m.height; ++row)
    EXPECT_NEAR(scan.points[scan.index(60, row)].z(), 500 - 10 * (row + 0.5) / m.height, 2e-3);
}

struct NoiseCase {
  double distance_mm, turn_rad;
};
class SensorNoise : public testing::TestWithParam<NoiseCase> {};

TEST_P(SensorNoise, GrowsWithTheSquareOfTheDistanceAndWithIncidence) {
  SensorModel m = ideal_sensor(160, 120);
  m.noise_mm = 0.05;
  m.near_mm = 100;
  m.far_mm = 2000;
  const TriangleMesh mesh = plate(3000, 3000, GetParam().distance_mm, GetParam().turn_rad);
  const Eigen::Vector3d normal(-std::sin(GetParam().turn_rad), 0, -std::cos(GetParam().turn_rad));
  const Scan scan = trace(m, mesh, 77);
  double sum = 0, chi2 = 0;
  int n = 0, beyond_two_sigma = 0;
  for (int row = 0; row < m.height; ++row) {
    for (int column = 0; column < m.width; ++column) {
      const size_t i = scan.index(column, row);
      const Eigen::Vector3d r = ray(m, column, row);
      const double cosine = -normal.dot(r);
      if (!scan.valid(i) || cosine < 0.51) continue;
      const Eigen::Vector3d p = scan.points[i].cast<double>();
      EXPECT_LT(p.cross(r).norm(), 1e-3) << "not on the pixel's ray";
      const double range = normal.z() * GetParam().distance_mm / normal.dot(r);
      const double sigma = 0.05 * (range / 500) * (range / 500) / cosine;
      const double z = (p.norm() - range) / sigma;
      sum += z;
      chi2 += z * z;
      beyond_two_sigma += std::abs(z) > 2;
      ++n;
    }
  }
  ASSERT_GT(n, 10000);
  // Four standard deviations of the mean, of chi-square and of the tail of a normal distribution.
  EXPECT_NEAR(sum / n, 0, 4 / std::sqrt(n));
  EXPECT_NEAR(chi2 / n, 1, 4 * std::sqrt(2.0 / n));
  EXPECT_NEAR(beyond_two_sigma / static_cast<double>(n), 0.0455, 4 * std::sqrt(0.0455 / n));
}

INSTANTIATE_TEST_SUITE_P(Planes, SensorNoise,
                         testing::Values(NoiseCase{500, 0}, NoiseCase{350, 0}, NoiseCase{700, 0},
                                         NoiseCase{500, 0.5}, NoiseCase{420, -0.6}));

TEST(Sensor, MeasuresNothingOutsideItsDepthOfField) {
  SensorModel m = ideal_sensor();
  m.noise_mm = 0.2;
  for (const double z : {347.0, 350.0, 700.0, 705.0, 2000.0}) {
    const Scan scan = trace(m, plate(3000, 3000, z));
    for (size_t i = 0; i < scan.points.size(); ++i) {
      if (!scan.valid(i)) continue;
      EXPECT_GE(scan.points[i].z(), 350);
      EXPECT_LE(scan.points[i].z(), 700);
    }
    const double share = static_cast<double>(scan.valid_count()) / static_cast<double>(scan.points.size());
    if (z == 350.0 || z == 700.0)
      EXPECT_NEAR(share, 0.5, 0.05) << "half of the noise is inside";
    else
      EXPECT_EQ(share, 0) << z;
  }
}

TEST(Sensor, APoleHidesFromTheProjectorTheStripeThatGeometrySays) {
  SensorModel m = ideal_sensor(600, 60);
  m.projector_offset_mm = 100;
  // Pole between x = -5 and 5 at depth 420, wall at 500. The projector stands at x = 100: its rays past the
  // pole's edges meet the wall at 100 + (edge - 100) * 500 / 420.
  const TriangleMesh scene = merged(plate(5, 500, 420), plate(2000, 2000, 500));
  const Scan scan = trace(m, scene);
  const double shadow_from = 100 + (-5 - 100) * 500.0 / 420, shadow_to = 100 + (5 - 100) * 500.0 / 420;
  int dark = 0, lit = 0, pole = 0;
  for (int row = 0; row < m.height; ++row) {
    for (int column = 0; column < m.width; ++column) {
      const Eigen::Vector3d r = ray(m, column, row);
      const double x_pole = r.x() / r.z() * 420, x_wall = r.x() / r.z() * 500;
      const bool valid = scan.valid(scan.index(column, row));
      constexpr double kEdge = 0.1;
      if (std::abs(std::abs(x_pole) - 5) < kEdge) continue;
      if (std::abs(x_wall - shadow_from) < kEdge || std::abs(x_wall - shadow_to) < kEdge) continue;
      if (std::abs(x_pole) < 5) {
        EXPECT_TRUE(valid);
        ++pole;
      } else if (x_wall > shadow_from && x_wall < shadow_to) {
        EXPECT_FALSE(valid) << "in the shadow at x = " << x_wall;
        ++dark;
      } else {
        EXPECT_TRUE(valid) << "lit at x = " << x_wall;
        ++lit;
      }
    }
  }
  EXPECT_GT(std::min({dark, lit, pole}), 500);
  // Without an offset nothing is hidden.
  m.projector_offset_mm = 0;
  EXPECT_EQ(trace(m, scene).valid_count(), scan.points.size());
}

TEST(Sensor, MixedPixelsLieBesideDepthStepsAndBetweenTheirSurfaces) {
  SensorModel m = ideal_sensor(200, 120);
  m.mixed_pixel_probability = 0.3;
  const TriangleMesh scene = merged(plate(40, 30, 450), plate(2000, 2000, 500));
  const Scan scan = trace(m, scene, 5);
  const auto on_front = [&](int column, int row) {
    const Eigen::Vector3d r = ray(m, column, row);
    return std::abs(r.x() / r.z() * 450) < 40 && std::abs(r.y() / r.z() * 450) < 30;
  };
  int beside = 0, mixed = 0;
  for (int row = 1; row + 1 < m.height; ++row) {
    for (int column = 1; column + 1 < m.width; ++column) {
      const bool front = on_front(column, row);
      const bool at_step = on_front(column - 1, row) != front || on_front(column + 1, row) != front ||
                           on_front(column, row - 1) != front || on_front(column, row + 1) != front;
      const float z = scan.points[scan.index(column, row)].z();
      const bool off_surface = std::abs(z - (front ? 450 : 500)) > 0.01;
      EXPECT_FALSE(off_surface && !at_step) << column << "," << row;
      if (off_surface) {
        EXPECT_GT(z, 449.5);
        EXPECT_LT(z, 500.5);
      }
      beside += at_step;
      mixed += off_surface;
    }
  }
  ASSERT_GT(beside, 300);
  EXPECT_NEAR(mixed / static_cast<double>(beside), 0.3, 4 * std::sqrt(0.3 * 0.7 / beside));
  m.mixed_pixel_step_mm = 60;
  const Scan small_step = trace(m, scene, 5);
  for (size_t i = 0; i < small_step.points.size(); ++i)
    EXPECT_LT(std::min(std::abs(small_step.points[i].z() - 450), std::abs(small_step.points[i].z() - 500)),
              0.01);
}

TEST(Sensor, ASurfaceSeenAtASlantHasNoMixedPixels) {
  SensorModel m = ideal_sensor(200, 120);
  m.mixed_pixel_probability = 1;
  m.mixed_pixel_step_mm = 0.5;
  // From pixel to pixel it falls by 1.7 mm of a pitch, three times the step.
  TriangleMesh slant = plate(100, 60, 500);
  for (auto& v : slant.vertices) v.z() += 1.2f * v.x();
  const Scan scan = trace(m, slant, 5);
  ASSERT_GT(scan.valid_count(), 3000u);
  for (size_t i = 0; i < scan.points.size(); ++i) {
    if (!scan.valid(i)) continue;
    EXPECT_NEAR(scan.points[i].z() - 1.2f * scan.points[i].x(), 500, 0.01);
  }
}

TEST(Sensor, PixelsDropOutAsOftenAsStated) {
  SensorModel m = ideal_sensor(200, 150);
  for (const double p : {0.0, 0.002, 0.1, 1.0}) {
    m.dropout_probability = p;
    const Scan scan = trace(m, plate(2000, 2000, 500));
    const double n = static_cast<double>(scan.points.size());
    EXPECT_NEAR(1 - static_cast<double>(scan.valid_count()) / n, p, 4 * std::sqrt(p * (1 - p) / n));
  }
}

TEST(Sensor, GrazingSurfacesAreMeasuredRarelyAndThenNotAtAll) {
  SensorModel m = ideal_sensor(200, 150);
  m.near_mm = 1;
  m.far_mm = 1e5;
  const auto share_at = [&](double incidence_deg) {
    const double turn = incidence_deg * std::numbers::pi / 180;
    const Scan scan = trace(m, plate(5e4, 5e4, 500, turn));
    const Eigen::Vector3d normal(-std::sin(turn), 0, -std::cos(turn));
    int seen = 0, of = 0;
    for (int row = 0; row < m.height; ++row) {
      for (int column = 0; column < m.width; ++column) {
        const double angle = std::acos(-normal.dot(ray(m, column, row))) * 180 / std::numbers::pi;
        if (std::abs(angle - incidence_deg) > 0.5) continue;
        seen += scan.valid(scan.index(column, row));
        ++of;
      }
    }
    return seen / static_cast<double>(of);
  };
  EXPECT_EQ(share_at(55), 1);
  EXPECT_GT(share_at(65), share_at(72) + 0.1);
  EXPECT_GT(share_at(72), share_at(78) + 0.1);
  EXPECT_EQ(share_at(81), 0);
  // The back of a surface is not seen.
  EXPECT_EQ(trace(m, plate(2000, 2000, 500, std::numbers::pi)).valid_count(), 0u);
}

TEST(Sensor, TheScanIsAFunctionOfSeedAndNumberAndNotOfThreads) {
  SensorModel m;
  m.width = 120;
  m.height = 80;
  const TriangleMesh scene = merged(plate(40, 30, 450, 0.3), plate(2000, 2000, 500));
  const auto with_threads = [&](size_t threads, uint64_t seed, uint64_t number) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return trace(m, scene, seed, number);
  };
  const Scan one = with_threads(1, 3, 0);
  EXPECT_TRUE(same_bytes(one, with_threads(2, 3, 0)));
  EXPECT_FALSE(same_bytes(one, with_threads(1, 4, 0))) << "another seed";
  EXPECT_FALSE(same_bytes(one, with_threads(1, 3, 1))) << "another scan of the same seed";
}

}  // namespace
}  // namespace gantry
