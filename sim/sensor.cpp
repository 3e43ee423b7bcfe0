#include "gantry/sim/sensor.h"

#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <numbers>

namespace gantry {
namespace {

/// SplitMix64: a stateless generator, so that a pixel's noise does not depend on who traced it when.
uint64_t mix(uint64_t x) {
  x += 0x9E3779B97F4A7C15ull;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
  return x ^ (x >> 31);
}

struct PixelRandom {
  uint64_t state;
  double uniform() {
    state = mix(state);
    return static_cast<double>(state >> 11) * 0x1.0p-53;
  }
  double gaussian() {
    const double u = 1.0 - uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2 * std::numbers::pi * uniform());
  }
};

/// SensorModel::distortion_mm as a function of the direction and the distance: a few waves over the volume, of
/// random direction, length and phase.
class Distortion {
 public:
  explicit Distortion(const SensorModel& model)
      : amplitude_(model.distortion_mm * std::sqrt(2.0 / kWaves)),
        x_scale_(1 / std::tan(0.5 * model.horizontal_fov_rad)),
        y_scale_(1 / std::tan(0.5 * model.vertical_fov_rad)),
        near_(model.near_mm),
        depth_(model.far_mm - model.near_mm) {
    PixelRandom random{mix(model.distortion_seed ^ 0xD157027104ull)};
    for (Wave& wave : waves_) {
      for (double& k : wave.number) k = std::numbers::pi * (2 * random.uniform() - 1);
      wave.phase = 2 * std::numbers::pi * random.uniform();
    }
  }
  double operator()(const Eigen::Vector3d& ray, double range) const {
    if (amplitude_ == 0) return 0;
    // Each coordinate runs from -1 to 1 through the volume.
    const double x = ray.x() / ray.z() * x_scale_, y = ray.y() / ray.z() * y_scale_,
                 z = 2 * (range * ray.z() - near_) / depth_ - 1;
    double sum = 0;
    for (const Wave& w : waves_)
      sum += std::cos(w.number[0] * x + w.number[1] * y + w.number[2] * z + w.phase);
    return amplitude_ * sum;
  }

 private:
  static constexpr int kWaves = 8;
  struct Wave {
    double number[3];
    double phase;
  };
  double amplitude_, x_scale_, y_scale_, near_, depth_;
  std::array<Wave, kWaves> waves_;
};

struct TracedPixel {
  float range = 0;                                   // along the ray, 0 where nothing is hit
  float cosine = 0;                                  // of the incidence angle
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  // in the sensor's frame
};

/// Whether what another ray hits lies off this pixel's tangent plane: more than `step` before or behind it.
bool off_tangent_plane(const TracedPixel& pixel, const Eigen::Vector3d& other_ray, double other_range,
                       double step) {
  const double other_cosine = -pixel.normal.cast<double>().dot(other_ray);
  if (other_cosine <= 0) return true;
  return std::abs(other_range - pixel.range * pixel.cosine / other_cosine) > step;
}

}  // namespace

double SensorModel::focal_x_px() const {
  return 0.5 * width / std::tan(0.5 * horizontal_fov_rad);
}
double SensorModel::focal_y_px() const {
  return 0.5 * height / std::tan(0.5 * vertical_fov_rad);
}

Scan trace_scan(const SensorModel& model, const RayScene& scene, const Pose& begin_scene_from_sensor,
                const Pose& end_scene_from_sensor, uint64_t seed, uint64_t scan_number) {
  const int w = model.width, h = model.height;
  const double fx = model.focal_x_px(), fy = model.focal_y_px();
  const double cx = 0.5 * (w - 1), cy = 0.5 * (h - 1);
  const auto ray = [&](int column, int row) {
    return Eigen::Vector3d((column - cx) / fx, (row - cy) / fy, 1.0).normalized();
  };
  const Vector6d motion = pose_log(end_scene_from_sensor * begin_scene_from_sensor.inverse());

  std::vector<TracedPixel> traced(static_cast<size_t>(w) * h);
  tbb::parallel_for(0, h, [&](int row) {
    const Pose scene_from_sensor = pose_exp(motion * ((row + 0.5) / h)) * begin_scene_from_sensor;
    const Eigen::Vector3f origin = scene_from_sensor.translation().cast<float>();
    const Eigen::Vector3f projector =
        (scene_from_sensor * Eigen::Vector3d(model.projector_offset_mm, 0, 0)).cast<float>();
    for (int column = 0; column < w; ++column) {
      const Eigen::Vector3f direction = (scene_from_sensor.linear() * ray(column, row)).cast<float>();
      const auto hit = scene.cast(origin, direction);
      if (!hit) continue;
      const Eigen::Vector3f normal = scene.mesh().normal(hit->triangle);
      const float cosine = -normal.dot(direction);
      if (cosine <= 0) continue;  // the back of an open surface
      const Eigen::Vector3f point = origin + hit->distance * direction;
      // Lifted off the surface by a little, or the shadow ray would meet the triangle it starts from.
      if (model.projector_offset_mm != 0 && scene.occluded(point + 0.01f * normal, projector)) continue;
      traced[static_cast<size_t>(row) * w + column] = {
          hit->distance, cosine, scene_from_sensor.linear().transpose().cast<float>() * normal};
    }
  });

  const Distortion distortion(model);
  const double min_cosine = std::cos(model.max_incidence_rad);
  const double grazing_cosine = 0.5;  // 60 degrees
  Scan scan;
  scan.width = w;
  scan.height = h;
  scan.points.assign(traced.size(), invalid_point());
  tbb::parallel_for(0, h, [&](int row) {
    for (int column = 0; column < w; ++column) {
      const size_t i = scan.index(column, row);
      const TracedPixel& pixel = traced[i];
      if (pixel.range == 0) continue;
      PixelRandom random{mix(mix(seed) ^ mix(scan_number * 0x100000001B3ull + i))};
      if (pixel.cosine < min_cosine) continue;
      double dropout = model.dropout_probability;
      if (pixel.cosine < grazing_cosine)
        dropout += (1 - dropout) * (grazing_cosine - pixel.cosine) / (grazing_cosine - min_cosine);
      if (random.uniform() < dropout) continue;
      const double distance_ratio = pixel.range / 500.0;
      double range =
          pixel.range + distortion(ray(column, row), pixel.range) + model.noise_mm * distance_ratio * distance_ratio / pixel.cosine * random.gaussian();
      if (random.uniform() < model.mixed_pixel_probability) {
        static constexpr int kSteps[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
        for (const auto& step : kSteps) {
          const int c = column + step[0], r = row + step[1];
          if (c < 0 || r < 0 || c >= w || r >= h) continue;
          const TracedPixel& other = traced[scan.index(c, r)];
          // A surface seen at a slant falls by as much from pixel to pixel, and is no step.
          if (other.range == 0 ||
              !off_tangent_plane(pixel, ray(c, r), other.range, model.mixed_pixel_step_mm) ||
              !off_tangent_plane(other, ray(column, row), pixel.range, model.mixed_pixel_step_mm))
            continue;
          range += random.uniform() * (other.range - pixel.range);
          break;
        }
      }
      const Eigen::Vector3d point = range * ray(column, row);
      if (point.z() < model.near_mm || point.z() > model.far_mm) continue;
      scan.points[i] = point.cast<float>();
    }
  });
  return scan;
}

}  // namespace gantry
