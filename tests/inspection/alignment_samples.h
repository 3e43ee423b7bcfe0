#pragma once

#include <cmath>
#include <functional>
#include <numbers>

#include "gantry/geometry/pose.h"
#include "gantry/inspection/alignment.h"
#include "inspection/samples.h"

namespace gantry {

inline PointCloud moved(PointCloud cloud, const Pose& pose) {
  for (auto& p : cloud.points) p = (pose * p.cast<double>()).cast<float>();
  for (auto& n : cloud.normals) n = (pose.linear() * n.cast<double>()).cast<float>();
  return cloud;
}

/// A turn by a rotation vector (degrees) about a point, then a shift.
inline Pose turn_about(const Eigen::Vector3d& point, const Eigen::Vector3d& turn_deg,
                       const Eigen::Vector3d& shift_mm) {
  Pose pose = Pose::Identity();
  pose.linear() = rotation_exp(std::numbers::pi / 180 * turn_deg);
  pose.translation() = point - pose.linear() * point + shift_mm;
  return pose;
}

/// Adds to each point's distance from the surface a smooth wave, the same for neighbours: what registration
/// leaves. Drawn anew for every seed, `length_mm` long, of standard deviation `sigma_mm`.
inline void add_waves(PointCloud& cloud, double sigma_mm, double length_mm, uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> phase(0, 2 * std::numbers::pi);
  constexpr int kWaves = 40;
  std::vector<Eigen::Vector4d> waves;
  for (int k = 0; k < kWaves; ++k)
    waves.emplace_back(normal(random) / length_mm, normal(random) / length_mm, normal(random) / length_mm,
                       phase(random));
  for (size_t i = 0; i < cloud.size(); ++i) {
    double height = 0;
    for (const auto& w : waves) height += std::cos(w.head<3>().dot(cloud.points[i].cast<double>()) + w[3]);
    cloud.points[i] += static_cast<float>(sigma_mm * height * std::sqrt(2.0 / kWaves)) * cloud.normals[i];
  }
}

/// (true pose - result)^2 in units of the stated covariance: chi-square with as many degrees of freedom as
/// motions are held, when the statement is honest.
inline double chi_square(const AlignmentResult& result, const Pose& cloud_from_cad) {
  const Vector6d error = pose_log((result.cad_from_cloud * cloud_from_cad).inverse());
  return error.dot(result.covariance.ldlt().solve(error));
}

/// 95 % of chi-square with this many degrees of freedom lies below.
inline double chi_square_95(size_t freedoms) {
  constexpr double kLimits[] = {0, 3.841, 5.991, 7.815, 9.488, 11.070, 12.592};
  return kLimits[freedoms];
}

}  // namespace gantry
