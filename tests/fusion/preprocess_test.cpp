#include "gantry/fusion/preprocess.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "foundation/expect_input_error.h"
#include "fusion/scenes.h"

namespace gantry {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// A rectangle about (x, 0, z) in the sensor frame, turned about the y axis.
TriangleMesh plate(double half_x, double half_y, double z, double turn_rad = 0, double x = 0) {
  TriangleMesh mesh;
  const Eigen::Matrix3d turn = rotation_exp({0, turn_rad, 0});
  for (const auto& [u, v] : {std::pair{-1, -1}, {1, -1}, {1, 1}, {-1, 1}})
    mesh.vertices.push_back(
        (turn * Eigen::Vector3d(u * half_x, v * half_y, 0) + Eigen::Vector3d(x, 0, z)).cast<float>());
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}};
  return mesh;
}

/// Towards the sensor.
Eigen::Vector3d plate_normal(double turn_rad) {
  return {-std::sin(turn_rad), 0, -std::cos(turn_rad)};
}

SensorModel without_shadows() {
  SensorModel model = small_sensor();
  model.projector_offset_mm = 0;
  return model;
}

TaggedScan plate_scan(double turn_rad, const SensorModel& model = without_shadows()) {
  return scan_of(RayScene(plate(120, 80, 500, turn_rad)), model, Pose::Identity(), 1, "plate");
}

/// A sphere of 60 mm radius seen from 500 mm, every pixel with noise along its ray.
constexpr double kSphereRadius = 60, kSphereDistance = 500;

TaggedScan sphere_scan(double noise_mm) {
  const SensorModel model = without_shadows();
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, noise_mm);
  TaggedScan tagged;
  tagged.name = "sphere";
  tagged.scan = {model.width, model.height, {}};
  tagged.scan.points.assign(static_cast<size_t>(model.width) * model.height, invalid_point());
  const Eigen::Vector3d centre(0, 0, kSphereDistance);
  for (int row = 0; row < model.height; ++row) {
    for (int column = 0; column < model.width; ++column) {
      const Eigen::Vector3d ray = Eigen::Vector3d((column - 0.5 * (model.width - 1)) / model.focal_x_px(),
                                                  (row - 0.5 * (model.height - 1)) / model.focal_y_px(), 1)
                                      .normalized();
      const double along = ray.dot(centre);
      const double root = along * along - centre.squaredNorm() + kSphereRadius * kSphereRadius;
      if (root > 0)
        tagged.scan.points[tagged.scan.index(column, row)] =
            ((along - std::sqrt(root) + noise(random)) * ray).cast<float>();
    }
  }
  return tagged;
}

double angle(const Eigen::Vector3f& a, const Eigen::Vector3d& b) {
  return std::acos(std::clamp(a.cast<double>().dot(b), -1.0, 1.0));
}

Eigen::Vector3d sphere_normal(const Eigen::Vector3f& p) {
  return (p.cast<double>() - Eigen::Vector3d(0, 0, kSphereDistance)).normalized();
}

void expect_normals_of_plate(const ScanSurface& surface, double turn_rad) {
  ASSERT_TRUE(surface.cloud.has_normals());
  double worst = 0, squares = 0, count = 0;
  for (size_t i = 0; i < surface.cloud.size(); ++i) {
    EXPECT_NEAR(surface.cloud.normals[i].norm(), 1, 1e-4);
    if (surface.rim[i]) continue;
    const double error = angle(surface.cloud.normals[i], plate_normal(turn_rad));
    worst = std::max(worst, error);
    squares += error * error;
    ++count;
  }
  EXPECT_LT(std::sqrt(squares / count), 1.5 * kDegree) << "turned by " << turn_rad;
  EXPECT_LT(worst, 8 * kDegree) << "turned by " << turn_rad;
}

Scan with_columns_reversed(Scan scan) {
  for (int row = 0; row < scan.height; ++row) {
    const auto begin = scan.points.begin() + static_cast<std::ptrdiff_t>(row) * scan.width;
    std::reverse(begin, begin + scan.width);
  }
  return scan;
}

TEST(Preprocess, NormalsOfAPlaneFaceTheSensor) {
  for (const double turn : {0.0, 0.5, -0.8}) {
    const ScanSurface surface = preprocess(plate_scan(turn), {});
    EXPECT_GT(surface.cloud.size(), 0.7 * static_cast<double>(surface.measured));
    expect_normals_of_plate(surface, turn);
  }
}

TEST(Preprocess, NormalsOfASphereFaceTheSensor) {
  const ScanSurface surface = preprocess(sphere_scan(0.03), {});
  ASSERT_GT(surface.cloud.size(), 10000u);
  for (size_t i = 0; i < surface.cloud.size(); ++i) {
    const Eigen::Vector3f& p = surface.cloud.points[i];
    EXPECT_LT(surface.cloud.normals[i].dot(p), 0);
    const Eigen::Vector3d truth = sphere_normal(p);
    // Where the view is not grazing.
    if (truth.dot(-p.cast<double>().normalized()) > 0.5) {
      ASSERT_LT(angle(surface.cloud.normals[i], truth), 6 * kDegree) << p.transpose();
    }
  }
}

TEST(Preprocess, StatedSigmaIsTheNoiseOfTheSensor) {
  for (const double noise_mm : {0.02, 0.1}) {
    for (const double turn : {0.0, 0.6}) {
      SensorModel model = without_shadows();
      model.noise_mm = noise_mm;
      const ScanSurface surface = preprocess(plate_scan(turn, model), {});
      const Eigen::Vector3d n = plate_normal(turn);
      double squares = 0, stated = 0;
      for (size_t i = 0; i < surface.cloud.size(); ++i) {
        const double distance = n.dot(surface.cloud.points[i].cast<double>() - Eigen::Vector3d(0, 0, 500));
        squares += distance * distance;
        stated += std::pow(surface.cloud.sigma_mm[i], 2);
      }
      const double ratio = std::sqrt(stated / squares);
      EXPECT_NEAR(ratio, 1, 0.25) << "noise " << noise_mm << " turned by " << turn;
      EXPECT_NEAR(surface.noise_mm, std::sqrt(squares / static_cast<double>(surface.cloud.size())),
                  0.25 * surface.noise_mm);
    }
  }
}

TEST(Preprocess, SpacingIsThatOfThePixels) {
  const ScanSurface surface = preprocess(plate_scan(0), {});
  const double pitch = 500 / small_sensor().focal_x_px();
  EXPECT_NEAR(surface.spacing_mm, pitch, 0.1 * pitch);
}

TEST(Preprocess, MixedPixelsAtAStepAreRemoved) {
  SensorModel model = without_shadows();
  model.mixed_pixel_probability = 1;
  for (const double step_mm : {6.0, 30.0}) {
    const RayScene scene(merged(plate(120, 80, 500 + step_mm), plate(40, 40, 500)));
    const TaggedScan scan = scan_of(scene, model, Pose::Identity(), 1);
    const auto far_from_both = [&](const Eigen::Vector3f& p) {
      const double z = p.z() - 500;
      return std::min(std::abs(z), std::abs(z - step_mm)) > 4 * model.noise_mm * 1.2;
    };
    ASSERT_GT(std::count_if(scan.scan.points.begin(), scan.scan.points.end(),
                            [&](const auto& p) { return far_from_both(p); }),
              100)
        << "the scene holds no mixed pixels to remove";
    const ScanSurface surface = preprocess(scan, {});
    const auto left = std::count_if(surface.cloud.points.begin(), surface.cloud.points.end(), far_from_both);
    EXPECT_LT(static_cast<double>(left), 1e-3 * static_cast<double>(surface.cloud.size()));
    EXPECT_GT(surface.dropped_edges, 100u);
    EXPECT_GT(static_cast<double>(surface.cloud.size()), 0.7 * static_cast<double>(surface.measured));
  }
}

TEST(Preprocess, CropBoxHoldsInThePartFrame) {
  TaggedScan scan = plate_scan(0);
  scan.part_from_sensor.mean = pose_from_position_rpy({10, 20, 30}, {0.3, -0.2, 1.0});
  const Eigen::Vector3d middle = scan.part_from_sensor.mean * Eigen::Vector3d(0, 0, 500);
  PreprocessOptions options;
  options.crop_part_mm = Eigen::AlignedBox3d(middle.array() - 25, middle.array() + 25);
  const ScanSurface surface = preprocess(scan, options);
  size_t inside = 0;
  for (size_t i = 0; i < scan.scan.points.size(); ++i)
    inside += scan.scan.valid(i) &&
              options.crop_part_mm->contains(scan.part_from_sensor.mean * scan.scan.points[i].cast<double>());
  for (const auto& p : surface.cloud.points)
    EXPECT_TRUE(options.crop_part_mm->contains(scan.part_from_sensor.mean * p.cast<double>()));
  EXPECT_EQ(surface.measured, scan.scan.valid_count());
  EXPECT_EQ(surface.dropped_crop, surface.measured - inside);
  EXPECT_EQ(surface.cloud.size() + surface.dropped_edges, inside);
  EXPECT_GT(static_cast<double>(surface.cloud.size()), 0.9 * static_cast<double>(inside));
}

TEST(Preprocess, RimOfTheDataIsMarked) {
  const ScanSurface surface = preprocess(plate_scan(0), {});
  const double pitch = surface.spacing_mm;
  for (size_t i = 0; i < surface.cloud.size(); ++i) {
    const Eigen::Vector3f& p = surface.cloud.points[i];
    const double from_side = 120 - std::abs(p.x()), from_end = 80 - std::abs(p.y());
    if (std::max(from_side, from_end) < 1.5 * pitch) {
      EXPECT_TRUE(surface.rim[i]) << p.transpose();
    } else if (std::min(from_side, from_end) > 5 * pitch) {
      EXPECT_FALSE(surface.rim[i]) << p.transpose();
    }
  }
}

/// The same points in no order.
TaggedScan without_grid(TaggedScan scan) {
  std::erase_if(scan.scan.points, [](const Eigen::Vector3f& p) { return !std::isfinite(p.z()); });
  std::shuffle(scan.scan.points.begin(), scan.scan.points.end(), std::mt19937(5));
  scan.scan.width = static_cast<int>(scan.scan.points.size());
  scan.scan.height = 1;
  return scan;
}

struct Accuracy {
  double distance_mm = 0, angle_rad = 0;  ///< RMS over the points that are not seen at a grazing angle.
  double seen = 0;                        ///< How many these are.
};

Accuracy accuracy_on_sphere(const ScanSurface& surface) {
  Accuracy accuracy;
  for (size_t i = 0; i < surface.cloud.size(); ++i) {
    const Eigen::Vector3f& p = surface.cloud.points[i];
    const Eigen::Vector3d truth = sphere_normal(p);
    if (truth.dot(p.cast<double>().normalized()) > -0.5) continue;
    accuracy.distance_mm +=
        std::pow((p.cast<double>() - Eigen::Vector3d(0, 0, kSphereDistance)).norm() - kSphereRadius, 2);
    accuracy.angle_rad += std::pow(angle(surface.cloud.normals[i], truth), 2);
    ++accuracy.seen;
  }
  accuracy.distance_mm = std::sqrt(accuracy.distance_mm / accuracy.seen);
  accuracy.angle_rad = std::sqrt(accuracy.angle_rad / accuracy.seen);
  return accuracy;
}

TEST(Preprocess, ScansWithoutAGridAreAsAccurate) {
  const TaggedScan organised = sphere_scan(0.03);
  const ScanSurface with = preprocess(organised, {}), without = preprocess(without_grid(organised), {});
  EXPECT_EQ(with.measured, without.measured);
  EXPECT_EQ(with.dropped_hidden, 0u);
  EXPECT_LT(static_cast<double>(without.dropped_hidden), 2e-3 * static_cast<double>(without.measured));
  const Accuracy a = accuracy_on_sphere(with), b = accuracy_on_sphere(without);
  EXPECT_GT(b.seen, 0.7 * a.seen);
  EXPECT_LT(b.distance_mm, 1.1 * a.distance_mm);
  EXPECT_LT(b.angle_rad, 1.1 * a.angle_rad);
}

TEST(Preprocess, PointsBehindOthersOfAScanWithoutAGridAreDroppedAndCounted) {
  TaggedScan both = without_grid(plate_scan(0));
  const size_t in_front = both.scan.points.size();
  const TaggedScan behind =
      without_grid(scan_of(RayScene(plate(60, 40, 560)), without_shadows(), Pose::Identity(), 2));
  both.scan.points.insert(both.scan.points.end(), behind.scan.points.begin(), behind.scan.points.end());
  both.scan.width = static_cast<int>(both.scan.points.size());
  const ScanSurface surface = preprocess(both, {});
  EXPECT_GT(static_cast<double>(surface.dropped_hidden),
            0.95 * static_cast<double>(behind.scan.points.size()));
  EXPECT_LE(surface.cloud.size(), in_front);
  size_t off = 0;
  for (const auto& p : surface.cloud.points) off += std::abs(p.z() - 500) > 0.4;
  EXPECT_LT(static_cast<double>(off), 3e-3 * static_cast<double>(surface.cloud.size()));
}

TEST(Preprocess, OptionsOutOfRangeAreNamed) {
  const auto refused = [](auto&& set, const char* key) {
    PreprocessOptions options;
    set(options);
    expect_input_error([&] { validate(options); }, {key});
    expect_input_error([&] { make_range_surface(plate_scan(0), options); }, {key});
    expect_input_error([&] { preprocess(plate_scan(0), options); }, {key});
  };
  EXPECT_NO_THROW(validate({}));
  refused([](auto& o) { o.normal_window_px = 1; }, "normal_window_px");
  refused([](auto& o) { o.normal_window_px = 51; }, "normal_window_px");
  refused([](auto& o) { o.normal_window_px = -3; }, "normal_window_px");
  refused([](auto& o) { o.edge_margin_px = -1; }, "edge_margin_px");
  refused([](auto& o) { o.min_window_fill = 1.1; }, "min_window_fill");
  refused([](auto& o) { o.min_window_fill = std::nan(""); }, "min_window_fill");
  refused([](auto& o) { o.crop_part_mm.emplace(); }, "crop_part_mm");
  refused(
      [](auto& o) {
        o.crop_part_mm = Eigen::AlignedBox3d(Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(1, -1, 1));
      },
      "crop_part_mm");
}

TEST(Preprocess, ScansWithoutAGridStateTheSameNoise) {
  const ScanSurface a = preprocess(plate_scan(0.3), {}), b = preprocess(without_grid(plate_scan(0.3)), {});
  EXPECT_NEAR(b.noise_mm, a.noise_mm, 0.25 * a.noise_mm);
  EXPECT_NEAR(b.spacing_mm, a.spacing_mm, 0.25 * a.spacing_mm);
}

TEST(Preprocess, AMirroredGridChangesNothing) {
  TaggedScan scan = plate_scan(0.5);
  scan.scan = with_columns_reversed(scan.scan);
  expect_normals_of_plate(preprocess(scan, {}), 0.5);
}

TEST(Preprocess, ParallelRaysAreRecognisedByTheGrid) {
  // A line scanner's scan: x to the right, y down, heights about the origin.
  TaggedScan tagged;
  tagged.scan.width = 100;
  tagged.scan.height = 80;
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 0.01f);
  for (int row = 0; row < 80; ++row)
    for (int column = 0; column < 100; ++column)
      tagged.scan.points.emplace_back(column - 50, row - 40,
                                      10 * std::sin(column * 0.05f) * std::cos(row * 0.04f) + noise(random));
  const ScanSurface surface = preprocess(tagged, {});
  for (const auto& n : surface.cloud.normals) EXPECT_LT(n.z(), 0);
}

TEST(Preprocess, TooFewPointsAreAnInputError) {
  TaggedScan scan = plate_scan(0);
  PreprocessOptions options;
  options.crop_part_mm = Eigen::AlignedBox3d(Eigen::Vector3d(0, 0, 400), Eigen::Vector3d(4, 4, 600));
  expect_input_error([&] { preprocess(scan, options); }, {"scan plate", "100", "cropping"});
  scan.scan.points.assign(scan.scan.points.size(), invalid_point());
  expect_input_error([&] { preprocess(scan, {}); }, {"scan plate", "only 0 of 0"});
  scan.scan = {50, 1, std::vector<Eigen::Vector3f>(50, Eigen::Vector3f(1, 2, 500))};
  expect_input_error([&] { preprocess(scan, {}); }, {"scan plate", "of 50 measured"});
}

}  // namespace
}  // namespace gantry
