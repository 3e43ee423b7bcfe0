#include "dented_plate.h"

#include <cmath>
#include <numbers>
#include <random>

#include "gantry/foundation/error.h"
#include "gantry/fusion/merge.h"
#include "gantry/fusion/preprocess.h"
#include "gantry/geometry/ray_scene.h"
#include "gantry/sim/sensor.h"

namespace gantry::bench {
namespace {

constexpr double kLength = 120, kWidth = 90, kThickness = 5, kGridMm = 0.3;
constexpr double kPitchMm = 15, kMarginMm = 15, kJitterMm = 2;
constexpr double kDistanceMm = 480, kTilt_rad = 0.35;

/// In [0, 1): std::uniform_real_distribution gives other numbers with other standard libraries.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}

/// Pixels as large as those of the default sensor, but only as many as the plate fills.
SensorModel plate_sensor() {
  SensorModel model;
  const double fx = model.focal_x_px(), fy = model.focal_y_px();
  model.width = 800;
  model.height = 640;
  model.horizontal_fov_rad = 2 * std::atan(0.5 * model.width / fx);
  model.vertical_fov_rad = 2 * std::atan(0.5 * model.height / fy);
  return model;
}

Pose looking_at_plate(double azimuth, std::mt19937_64& random) {
  const auto jitter = [&](double size) { return size * (2 * uniform(random) - 1); };
  const double tilt = kTilt_rad + jitter(0.035), roll = jitter(0.035);
  Pose pose = Pose::Identity();
  pose.rotate(Eigen::AngleAxisd(azimuth, Eigen::Vector3d::UnitZ()));
  pose.rotate(Eigen::AngleAxisd(tilt, Eigen::Vector3d::UnitX()));
  pose.rotate(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()));
  pose.rotate(Eigen::AngleAxisd(-azimuth, Eigen::Vector3d::UnitZ()));  // the plate lies along the image
  pose.rotate(Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()));  // the sensor's z looks down
  pose.translate(Eigen::Vector3d(jitter(5), jitter(5), -kDistanceMm + jitter(5)));
  return pose;
}

}  // namespace

TriangleMesh dented_plate(const std::vector<Dent>& dents) {
  const int nx = static_cast<int>(std::lround(kLength / kGridMm)),
            ny = static_cast<int>(std::lround(kWidth / kGridMm));
  TriangleMesh mesh;
  const auto add = [&](double x, double y, double z) {
    mesh.vertices.emplace_back(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
    return static_cast<int>(mesh.vertices.size()) - 1;
  };
  for (int ix = 0; ix <= nx; ++ix)
    for (int iy = 0; iy <= ny; ++iy) {
      const double x = kLength * ix / nx - kLength / 2, y = kWidth * iy / ny - kWidth / 2;
      double z = 0;
      for (const Dent& dent : dents) {
        const double r = 2 * std::hypot(x - dent.centre_mm.x(), y - dent.centre_mm.y()) / dent.diameter_mm;
        if (r < 1) z -= dent.depth_mm / 2 * (1 + std::cos(std::numbers::pi * r));
      }
      add(x, y, z);
    }
  const auto at = [&](int ix, int iy) { return ix * (ny + 1) + iy; };
  for (int ix = 0; ix < nx; ++ix)
    for (int iy = 0; iy < ny; ++iy) {
      mesh.triangles.emplace_back(at(ix, iy), at(ix + 1, iy), at(ix + 1, iy + 1));
      mesh.triangles.emplace_back(at(ix, iy), at(ix + 1, iy + 1), at(ix, iy + 1));
    }
  std::vector<int> rim;  // counter-clockwise seen from above
  for (int ix = 0; ix < nx; ++ix) rim.push_back(at(ix, 0));
  for (int iy = 0; iy < ny; ++iy) rim.push_back(at(nx, iy));
  for (int ix = nx; ix > 0; --ix) rim.push_back(at(ix, ny));
  for (int iy = ny; iy > 0; --iy) rim.push_back(at(0, iy));
  std::vector<int> below;
  for (const int v : rim) below.push_back(add(mesh.vertices[v].x(), mesh.vertices[v].y(), -kThickness));
  const int middle = add(0, 0, -kThickness);
  for (size_t i = 0; i < rim.size(); ++i) {
    const size_t next = (i + 1) % rim.size();
    mesh.triangles.emplace_back(rim[i], below[i], below[next]);
    mesh.triangles.emplace_back(rim[i], below[next], rim[next]);
    mesh.triangles.emplace_back(middle, below[next], below[i]);
  }
  return mesh;
}

std::vector<Eigen::Vector2d> dent_places(size_t count, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<Eigen::Vector2d> places;
  for (double x = kMarginMm - kLength / 2; x <= kLength / 2 - kMarginMm + 1e-9; x += kPitchMm)
    for (double y = kMarginMm - kWidth / 2; y <= kWidth / 2 - kMarginMm + 1e-9; y += kPitchMm)
      places.emplace_back(x + kJitterMm * (2 * uniform(random) - 1),
                          y + kJitterMm * (2 * uniform(random) - 1));
  if (count > places.size())
    throw InputError("a plate holds " + std::to_string(places.size()) + " dents at most");
  for (size_t i = places.size(); i-- > 1;) std::swap(places[i], places[random() % (i + 1)]);
  places.resize(count);
  return places;
}

PointCloud scanned_plate(const TriangleMesh& plate, uint64_t seed) {
  const RayScene scene(plate);
  const SensorModel sensor = plate_sensor();
  std::mt19937_64 random(seed);
  std::vector<RangeSurface> surfaces;
  std::vector<Pose> poses;
  for (int view = 0; view < 4; ++view) {
    const Pose pose = looking_at_plate(std::numbers::pi / 2 * view, random);
    TaggedScan scan;
    scan.name = "view " + std::to_string(view);
    scan.scan = trace_scan(sensor, scene, pose, pose, seed, static_cast<uint64_t>(view));
    scan.part_from_sensor.mean = pose;
    surfaces.push_back(make_range_surface(scan, {}));
    poses.push_back(pose);
  }
  return merge_surfaces(surfaces, poses, {});
}

}  // namespace gantry::bench
