#include "gantry/fusion/range_surface.h"

#include <gtest/gtest.h>

#include <mutex>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "fusion/scenes.h"
#include "gantry/geometry/surface_index.h"
#include "gantry/sim/scan_set.h"
#include "geometry/solids.h"
#include "range_image/grid_normals.h"
#include "range_image/ray_model.h"

namespace gantry {
namespace {

using internal::fit_rays;
using internal::PixelSample;

constexpr double kDegree = std::numbers::pi / 180;

/// Points of a bumpy surface through the pixels of a pinhole camera with radial distortion.
std::vector<PixelSample> camera_samples(double distortion, const Pose& scan_from_camera) {
  std::vector<PixelSample> samples;
  for (int row = 0; row < 600; row += 20)
    for (int column = 0; column < 800; column += 20) {
      const double x = (column - 400) / 1200.0, y = (row - 300) / 1200.0;
      const double stretch = 1 + distortion * (x * x + y * y);
      const double z = 500 + 40 * std::sin(column / 50.0) + 30 * std::cos(row / 37.0);
      samples.push_back({Eigen::Vector2d(column, row),
                         scan_from_camera * Eigen::Vector3d(x * stretch * z, y * stretch * z, z)});
    }
  return samples;
}

double worst_error_px(const internal::FittedRays& fitted, const std::vector<PixelSample>& samples) {
  double worst = 0;
  for (const PixelSample& s : samples) {
    const Eigen::Vector3d p = fitted.sensor_from_grid.inverse() * s.point;
    worst = std::max(worst, (fitted.rays.pixel(fitted.rays.ray_of(p)) - s.pixel).norm());
    const Eigen::Vector3d back =
        fitted.rays.point(fitted.rays.ray(s.pixel.x(), s.pixel.y()), fitted.rays.w_of(p));
    EXPECT_LT((back - p).norm(), 0.02);
  }
  return worst;
}

TEST(RayModel, FindsAPinholeCameraAtTheOrigin) {
  const auto samples = camera_samples(0, Pose::Identity());
  const auto fitted = fit_rays(samples);
  ASSERT_TRUE(fitted);
  EXPECT_TRUE(fitted->rays.central);
  EXPECT_FALSE(fitted->rays.distorted);
  EXPECT_TRUE(fitted->sensor_known);
  EXPECT_LT(worst_error_px(*fitted, samples), 1e-6);
}

TEST(RayModel, TakesALensIntoAccount) {
  const auto samples = camera_samples(0.05, Pose::Identity());
  const auto fitted = fit_rays(samples);
  ASSERT_TRUE(fitted);
  EXPECT_TRUE(fitted->rays.distorted);
  EXPECT_LT(worst_error_px(*fitted, samples), 0.05);
}

TEST(RayModel, FindsACameraThatIsNotAtTheOrigin) {
  Pose elsewhere = pose_from_position_rpy({300, -200, 100}, {0.3, -0.4, 0.5});
  const auto samples = camera_samples(0, elsewhere);
  const auto fitted = fit_rays(samples);
  ASSERT_TRUE(fitted);
  EXPECT_TRUE(fitted->rays.central);
  EXPECT_LT(translation_distance(fitted->sensor_from_grid, elsewhere), 1e-3);
  EXPECT_LT(worst_error_px(*fitted, samples), 1e-3);
}

TEST(RayModel, FindsParallelRays) {
  std::vector<PixelSample> samples;
  const Eigen::Matrix3d turn = rotation_exp({0.5, 0.2, -0.1});
  for (int row = 0; row < 100; row += 3)
    for (int column = 0; column < 120; column += 3)
      samples.push_back({Eigen::Vector2d(column, row),
                         turn * Eigen::Vector3d(0.4 * column - 24, 0.6 * row - 30,
                                                5 * std::sin(column / 9.0) + 4 * std::cos(row / 7.0) +
                                                    0.02 * std::pow(0.4 * column - 24, 2))});
  const auto fitted = fit_rays(samples);
  ASSERT_TRUE(fitted);
  EXPECT_FALSE(fitted->rays.central);
  EXPECT_FALSE(fitted->sensor_known);
  // Towards the scene: the surface bulges towards the sensor.
  EXPECT_GT(fitted->sensor_from_grid.linear().col(2).dot(turn.col(2)), 0.9999);
  EXPECT_LT(worst_error_px(*fitted, samples), 1e-6);
}

TEST(RayModel, RefusesAGridThatNoRaysExplain) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> anywhere(-50, 50);
  std::vector<PixelSample> samples;
  for (int i = 0; i < 500; ++i)
    samples.push_back({Eigen::Vector2d(i % 25, i / 25),
                       Eigen::Vector3d(anywhere(random), anywhere(random), 500 + anywhere(random))});
  EXPECT_FALSE(fit_rays(samples));
}

TEST(PackedNormal, KeepsADirectionWithinATenThousandth) {
  std::mt19937 random(5);
  for (int i = 0; i < 2000; ++i) {
    const Eigen::Vector3f n = random_direction(random).cast<float>();
    EXPECT_LT((unpack_normal(pack_normal(n)) - n).norm(), 1e-4f);
  }
  for (const Eigen::Vector3f& n :
       {Eigen::Vector3f(0, 0, 1), Eigen::Vector3f(0, 0, -1), Eigen::Vector3f(-1, 0, 0)})
    EXPECT_LT((unpack_normal(pack_normal(n)) - n).norm(), 1e-4f);
}

/// Brute force of what fit_windows promises.
Eigen::Vector3d plane_of_window(const std::vector<float>& w, int width, int height, int half, int column,
                                int row, int& count) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  count = 0;
  for (int dy = -half; dy <= half; ++dy)
    for (int dx = -half; dx <= half; ++dx) {
      const int c = column + dx, r = row + dy;
      if (c < 0 || r < 0 || c >= width || r >= height || (std::abs(dx) <= 1 && std::abs(dy) <= 1)) continue;
      const float value = w[static_cast<size_t>(r) * width + c];
      if (value == 0) continue;
      const Eigen::Vector3d a(1, dx, dy);
      normal += a * a.transpose();
      right += a * value;
      ++count;
    }
  return normal.ldlt().solve(right);
}

TEST(GridNormals, AgreeWithBruteForceWhereverPixelsAreMissing) {
  const int width = 61, height = 117, half = 3;  // more than one band of rows
  std::mt19937 random(9);
  std::uniform_real_distribution<float> value(0.5f, 1.5f);
  std::bernoulli_distribution missing(0.3);
  std::vector<float> w(static_cast<size_t>(width) * height);
  for (float& x : w) x = missing(random) ? 0.0f : value(random);
  int checked = 0;
  std::mutex mutex;
  internal::fit_windows(w, width, height, half, [&](int row, const internal::WindowFit& fit) {
    const std::lock_guard lock(mutex);
    for (int column = 0; column < width; ++column) {
      int count = 0;
      const Eigen::Vector3d plane = plane_of_window(w, width, height, half, column, row, count);
      ASSERT_EQ(fit.count[column], static_cast<float>(count)) << column << " " << row;
      if (count < 12) continue;
      EXPECT_NEAR(fit.value[column], plane[0], 1e-3);
      EXPECT_NEAR(fit.column_slope[column], plane[1], 1e-3);
      EXPECT_NEAR(fit.row_slope[column], plane[2], 1e-3);
      ++checked;
    }
  });
  EXPECT_GT(checked, width * height * 9 / 10);
}

/// Distances of the surface's points and angles of its normals from a mesh (median).
struct Quality {
  double distance_mm, angle_rad;
};
Quality quality_of(const RangeSurface& surface, const Pose& part_from_sensor, const SurfaceIndex& part) {
  const PointCloud cloud = surface_cloud(surface);
  std::vector<double> distances, angles;
  for (size_t i = 0; i < cloud.size(); i += 17) {
    const Eigen::Vector3f p = (part_from_sensor * cloud.points[i].cast<double>()).cast<float>();
    const Eigen::Vector3f n = (part_from_sensor.linear() * cloud.normals[i].cast<double>()).cast<float>();
    const auto closest = part.closest(p, 5);
    if (!closest) continue;
    const Eigen::Vector3f m = part.mesh().normal(static_cast<size_t>(closest->triangle));
    distances.push_back(std::abs(m.dot(p - closest->point)));
    angles.push_back(std::acos(std::clamp(m.dot(n), -1.0f, 1.0f)));
  }
  std::sort(distances.begin(), distances.end());
  std::sort(angles.begin(), angles.end());
  return {distances[distances.size() / 2], angles[angles.size() / 2]};
}

TEST(RangeSurface, IsAsGoodWithoutTheGrid) {
  const RayScene scene(make_bracket());
  const Pose pose = bracket_view(0.7, 0.8);
  const TaggedScan organised = scan_of(scene, small_sensor(960), pose, 3);
  TaggedScan unorganised = organised;
  unorganised.scan.points.clear();
  for (size_t i = 0; i < organised.scan.points.size(); ++i)
    if (organised.scan.valid(i)) unorganised.scan.points.push_back(organised.scan.points[i]);
  unorganised.scan.width = static_cast<int>(unorganised.scan.points.size());
  unorganised.scan.height = 1;
  const RangeSurface with = make_range_surface(organised, {}), without = make_range_surface(unorganised, {});
  EXPECT_TRUE(without.rays.central);
  EXPECT_TRUE(without.sensor_known);
  EXPECT_GT(without.usable, with.usable * 6 / 10);
  EXPECT_NEAR(without.spacing_mm, with.spacing_mm, 0.3 * with.spacing_mm);
  EXPECT_LT(static_cast<double>(without.dropped_hidden), 0.01 * static_cast<double>(without.measured));
  const SurfaceIndex part(make_bracket());
  const Quality a = quality_of(with, pose, part), b = quality_of(without, pose, part);
  EXPECT_LT(b.distance_mm, 1.15 * a.distance_mm);
  EXPECT_LT(b.angle_rad, 1.3 * a.angle_rad + 0.2 * kDegree);
}

TEST(RangeSurface, ScanInAnotherFrameIsTheSameSurface) {
  const RayScene scene(make_bracket());
  const Pose pose = bracket_view(0.7, 0.8);
  const TaggedScan in_sensor = scan_of(scene, small_sensor(480), pose, 3);
  TaggedScan in_world = in_sensor;
  for (auto& p : in_world.scan.points) p = (pose * p.cast<double>()).cast<float>();
  const RangeSurface a = make_range_surface(in_sensor, {}), b = make_range_surface(in_world, {});
  ASSERT_TRUE(b.rays.central);
  EXPECT_LT(translation_distance(b.sensor_from_grid, pose), 0.5);
  EXPECT_NEAR(static_cast<double>(b.usable), static_cast<double>(a.usable),
              0.01 * static_cast<double>(a.usable));
  const PointCloud cloud_a = surface_cloud(a), cloud_b = surface_cloud(b);
  const Eigen::Vector3f na = (pose.linear() * cloud_a.normals[500].cast<double>()).cast<float>();
  double best = 1e9;
  Eigen::Vector3f nb = Eigen::Vector3f::Zero();
  for (size_t i = 0; i < cloud_b.size(); ++i) {
    const double d = (cloud_b.points[i].cast<double>() - pose * cloud_a.points[500].cast<double>()).norm();
    if (d < best) {
      best = d;
      nb = cloud_b.normals[i];
    }
  }
  EXPECT_LT(best, 0.01);
  EXPECT_GT(na.dot(nb), 0.999f);
}

TEST(RangeSurface, DropsMixedPixels) {
  // A plate in front of another: pixels in between belong to neither.
  TriangleMesh mesh =
      merged(box_mesh({-150, -150, 560}, {150, 150, 570}), box_mesh({-60, -40, 495}, {60, 40, 500}));
  SensorModel model = small_sensor(960);
  model.mixed_pixel_probability = 1;
  model.projector_offset_mm = 0;
  const RayScene scene(mesh);
  const TaggedScan scan = scan_of(scene, model, Pose::Identity(), 1);
  const auto between = [](const Eigen::Vector3f& p) { return p.z() > 501 && p.z() < 559; };
  size_t mixed = 0;
  for (size_t i = 0; i < scan.scan.points.size(); ++i)
    mixed += scan.scan.valid(i) && between(scan.scan.points[i]);
  ASSERT_GT(mixed, 200u);
  size_t left = 0;
  for (const auto& p : surface_cloud(make_range_surface(scan, {})).points) left += between(p);
  EXPECT_LE(left, mixed / 100);
}

TEST(RangeSurface, NoiseIsToldWithinATenth) {
  for (const double noise : {0.01, 0.05, 0.3}) {
    SensorModel model = small_sensor(960);
    model.noise_mm = noise;
    const RayScene scene(box_mesh({-80, -60, 500}, {80, 60, 520}));
    const RangeSurface surface = make_range_surface(scan_of(scene, model, Pose::Identity(), 1), {});
    EXPECT_NEAR(surface.noise_mm, noise, 0.15 * noise);
  }
}

TEST(RangeSurface, NoiseAlongTheNormalIsToldHoweverTheSurfaceSlants) {
  SensorModel model = small_sensor(960);
  model.noise_mm = 0.05;  // along the normal, at 500 mm; along the ray 1 / cos as much
  for (const double slant : {0.0, 0.5, 0.9}) {
    const RayScene scene(transformed(
        box_mesh({-80, -60, 0}, {80, 60, 20}),
        Pose(Eigen::Translation3d(0, 0, 500) * Eigen::AngleAxisd(slant, Eigen::Vector3d::UnitY()))));
    const RangeSurface surface = make_range_surface(scan_of(scene, model, Pose::Identity(), 1), {});
    EXPECT_NEAR(surface.sigma_mm({0, 0, 500}), 0.05, 0.005) << slant;
    EXPECT_NEAR(surface.sigma_mm({0, 0, 600}), 0.05 * 1.44, 0.008) << slant;
    EXPECT_NEAR(surface.noise_mm, 0.05 / std::cos(slant), 0.1 * 0.05 / std::cos(slant)) << slant;
  }
}

TEST(RangeSurface, TooFewPointsAreRefused) {
  TaggedScan scan;
  scan.name = "lonely";
  scan.scan = {1, 1, {Eigen::Vector3f(0, 0, 500)}};
  expect_input_error([&] { make_range_surface(scan, {}); }, {"lonely", "1 of 1"});
  scan.scan.points.assign(1, invalid_point());
  expect_input_error([&] { make_range_surface(scan, {}); }, {"lonely", "0 of 0"});
  // Duplicates only.
  scan.scan.points.assign(5000, Eigen::Vector3f(1, 2, 500));
  scan.scan.width = 5000;
  expect_input_error([&] { make_range_surface(scan, {}); }, {"lonely"});
}

TEST(RangeSurface, ZerosAreWhereNothingWasMeasured) {
  TaggedScan scan = scan_of(RayScene(make_bracket()), small_sensor(), bracket_view(0.5, 0.9), 1);
  const RangeSurface expected = make_range_surface(scan, {});
  for (size_t i = 0; i < scan.scan.points.size(); ++i)
    if (!scan.scan.valid(i)) scan.scan.points[i].setZero();
  const RangeSurface found = make_range_surface(scan, {});
  EXPECT_EQ(found.measured, expected.measured);
  EXPECT_EQ(found.w, expected.w);
  EXPECT_EQ(found.flags, expected.flags);
}

TEST(RangeSurface, PointsFarAwayFromAllOthersAreNamed) {
  TaggedScan scan = scan_of(RayScene(make_bracket()), small_sensor(), bracket_view(0.5, 0.9), 1);
  scan.scan = without_grid(scan.scan);
  scan.scan.points.push_back(Eigen::Vector3f(-10000, 5000, -3000));
  scan.scan.width = static_cast<int>(scan.scan.points.size());
  expect_input_error([&] { make_range_surface(scan, {}); }, {"scan scan", "stray"});
}

}  // namespace
}  // namespace gantry
