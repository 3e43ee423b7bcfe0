#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"
#include "gantry/geometry/scan.h"

namespace gantry {

/// Where the pixels of a range image look: `central` rays meet in the origin of the grid frame, as those
/// of a camera; `parallel` rays run along its z axis, as those of a line scanner on a stage. A pixel's
/// ray is (u, v): x / z and y / z of its points if central, x and y if parallel; pixels and rays are
/// mapped to each other by polynomials of third degree, which holds a lens's distortion.
///
/// `w` is the depth coordinate in which a plane is linear in (u, v), so that it may be interpolated and
/// fitted linearly: 1 / z if central, z if parallel.
struct RayModel {
  static constexpr int kTerms = 10;  ///< 1, a, b, aa, ab, bb, aaa, aab, abb, bbb
  using Polynomial = Eigen::Matrix<double, 2, kTerms>;

  bool central = true;
  bool distorted = false;  ///< False: both polynomials are linear.
  Polynomial ray_of_pixel = Polynomial::Zero();
  Polynomial pixel_of_ray = Polynomial::Zero();

  static Eigen::Matrix<double, kTerms, 1> terms(double a, double b);
  Eigen::Vector2d ray(double column, double row) const { return ray_of_pixel * terms(column, row); }
  Eigen::Vector2d pixel(const Eigen::Vector2d& ray) const { return pixel_of_ray * terms(ray.x(), ray.y()); }
  Eigen::Vector3d point(const Eigen::Vector2d& ray, double w) const {
    return central ? Eigen::Vector3d(ray.x() / w, ray.y() / w, 1 / w) : Eigen::Vector3d(ray.x(), ray.y(), w);
  }
  Eigen::Vector2d ray_of(const Eigen::Vector3d& p) const {
    return central ? Eigen::Vector2d(p.x() / p.z(), p.y() / p.z()) : Eigen::Vector2d(p.x(), p.y());
  }
  double w_of(const Eigen::Vector3d& p) const { return central ? 1 / p.z() : p.z(); }
};

/// A unit vector in four bytes (octahedral map, error below 1e-4 rad).
struct PackedNormal {
  int16_t a = 0, b = 0;
};
PackedNormal pack_normal(const Eigen::Vector3f& n);
inline Eigen::Vector3f unpack_normal(PackedNormal packed) {
  Eigen::Vector3f n(static_cast<float>(packed.a) / 32767.0f, static_cast<float>(packed.b) / 32767.0f, 0);
  n.z() = 1.0f - std::abs(n.x()) - std::abs(n.y());
  const float fold = std::max(-n.z(), 0.0f);
  n.x() += n.x() >= 0 ? -fold : fold;
  n.y() += n.y() >= 0 ? -fold : fold;
  return n / std::sqrt(n.squaredNorm());
}

/// A place where a scan's surface ends though it was in full view: at the rim of a hole, at the border of a
/// plate. Wherever it is seen from, it ends there, so two scans that share it cannot slide across it. In
/// the grid frame.
struct SurfaceEdge {
  Eigen::Vector3f point;     ///< Where the surface ends.
  Eigen::Vector3f normal;    ///< Of the surface, towards the sensor.
  Eigen::Vector3f outwards;  ///< Unit vector in the surface, across the edge, away from the material.
};

/// One scan made ready for registration: the surface that the sensor saw, as a range image with normals.
/// It is what every stage works on, and all that is kept of a scan: 9 bytes a pixel of the rectangle
/// that holds data. Scans without a grid are given one.
struct RangeSurface {
  std::string name;
  UncertainPose part_from_sensor;  ///< As tagged.
  /// The frame in which rays are central or parallel; the sensor's own unless rays are oblique.
  Pose sensor_from_grid = Pose::Identity();
  RayModel rays;
  int width = 0, height = 0;
  std::vector<float> w;               ///< Depth coordinate, row by row; 0: nothing known here.
  std::vector<PackedNormal> normals;  ///< In the grid frame, towards the sensor.
  std::vector<unsigned char> flags;
  std::vector<SurfaceEdge> edges;

  static constexpr unsigned char kUsable =
      1;                                     ///< Passed all filters and has a normal; all others have w = 0.
  static constexpr unsigned char kRim = 2;   ///< At the border of the data: nothing may be matched to it.
  static constexpr unsigned char kSeen = 4;  ///< Measured, though perhaps dropped: the pixel is not empty.

  double spacing_mm = 0;  ///< Median distance of neighbouring points.
  double noise_mm = 0;    ///< Median standard uncertainty of the depth, along the viewing direction.
  double noise_scale =
      0;  ///< sigma along the normal = noise_scale * squared distance (central) or noise_scale.
  int normal_window_px = 0;   ///< Half width of the windows in which normals were fitted.
  bool sensor_known = true;   ///< False: which side the sensor stood on was guessed.
  size_t measured = 0;        ///< Valid points of the scan.
  size_t dropped_crop = 0;    ///< Outside the part's volume.
  size_t dropped_edges = 0;   ///< At depth steps, outliers, grazing, or without enough neighbours.
  size_t dropped_hidden = 0;  ///< Of a scan without grid: behind other points of it.
  size_t usable = 0;

  size_t index(int column, int row) const { return static_cast<size_t>(row) * width + column; }
  Eigen::Vector3d point(int column, int row) const {
    return rays.point(rays.ray(column, row), w[index(column, row)]);
  }
  double sigma_mm(const Eigen::Vector3d& p) const {
    return rays.central ? noise_scale * p.squaredNorm() : noise_scale;
  }
  Pose part_from_grid() const { return part_from_sensor.mean * sensor_from_grid; }
};

/// The same surface seen from the other side: for scans of which it was not known where the sensor stood.
void turn_over(RangeSurface& surface);

/// Turns those scans over of which the sensor's side was guessed (sensor_known is false) and that, at their
/// tagged poses, face the middle of the part that all scans make up. Returns how many.
size_t settle_unknown_sides(std::span<RangeSurface> surfaces);

/// The usable points in the `sensor` frame with normals and sigma; `rim` (optional) tells which lie on
/// the border of the data.
PointCloud surface_cloud(const RangeSurface& surface, std::vector<unsigned char>* rim = nullptr);

}  // namespace gantry
