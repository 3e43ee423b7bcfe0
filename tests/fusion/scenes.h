#pragma once

#include <random>

#include "gantry/fusion/preprocess.h"
#include "gantry/sim/bracket.h"
#include "gantry/sim/sensor.h"

namespace gantry {

/// The simulated sensor with fewer pixels: with 480 columns they are 0.7 mm apart at 500 mm.
inline SensorModel small_sensor(int width = 480) {
  SensorModel model;
  model.width = width;
  model.height = width * 5 / 8;
  return model;
}

/// scene_from_sensor of a sensor at `eye` that looks at `at`, x to the right and y down.
inline Pose looking_at(const Eigen::Vector3d& eye, const Eigen::Vector3d& at) {
  const Eigen::Vector3d z = (at - eye).normalized();
  const Eigen::Vector3d helper =
      std::abs(z.z()) > 0.99 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d(-Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d x = helper.cross(z).normalized();
  Pose pose = Pose::Identity();
  pose.linear() << x, z.cross(x), z;
  pose.translation() = eye;
  return pose;
}

/// A scan whose tag is the truth.
inline TaggedScan scan_of(const RayScene& scene, const SensorModel& model, const Pose& scene_from_sensor,
                          uint64_t number, const std::string& name = "scan") {
  TaggedScan scan;
  scan.name = name;
  scan.scan = trace_scan(model, scene, scene_from_sensor, scene_from_sensor, 7, number);
  scan.part_from_sensor.mean = scene_from_sensor;
  return scan;
}

/// Where the bracket's middle lies in the part frame.
inline Eigen::Vector3d bracket_middle() {
  return {60, 0, 20};
}

/// A view of the bracket from 500 mm away.
inline Pose bracket_view(double azimuth_rad, double elevation_rad) {
  const Eigen::Vector3d direction(std::cos(elevation_rad) * std::cos(azimuth_rad),
                                  std::cos(elevation_rad) * std::sin(azimuth_rad), std::sin(elevation_rad));
  return looking_at(bracket_middle() + 500 * direction, bracket_middle());
}

inline Eigen::Vector3d random_direction(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

/// A rotation about `centre` by `rotation_rad` and a shift by `shift_mm`, both in a random direction.
inline Pose random_motion(std::mt19937& random, const Eigen::Vector3d& centre, double shift_mm,
                          double rotation_rad) {
  Pose motion = Pose::Identity();
  motion.linear() = rotation_exp(rotation_rad * random_direction(random));
  motion.translation() = centre - motion.linear() * centre + shift_mm * random_direction(random);
  return motion;
}

/// Covariance of motions about `centre` with these standard deviations along and about each axis.
inline Matrix6d covariance_about(const Eigen::Vector3d& centre, double shift_sigma_mm,
                                 double rotation_sigma_rad) {
  Matrix6d at_centre = Matrix6d::Zero();
  at_centre.diagonal().head<3>().setConstant(rotation_sigma_rad * rotation_sigma_rad);
  at_centre.diagonal().tail<3>().setConstant(shift_sigma_mm * shift_sigma_mm);
  Matrix6d origin_from_centre = Matrix6d::Identity();
  origin_from_centre.bottomLeftCorner<3, 3>() = cross_matrix(centre);
  return origin_from_centre * at_centre * origin_from_centre.transpose();
}

/// The furthest that two poses put the same point of a surface apart.
inline double worst_displacement_mm(const ScanSurface& surface, const Pose& a, const Pose& b) {
  double worst = 0;
  for (const auto& p : surface.cloud.points)
    worst = std::max(worst, (a * p.cast<double>() - b * p.cast<double>()).norm());
  return worst;
}

}  // namespace gantry
