#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "gantry/geometry/ray_scene.h"
#include "gantry/geometry/triangle_mesh.h"
#include "gantry/inspection/inspection.h"

namespace gantry::report {

/// An orthographic camera. Pixels count from the top left corner, pixel (i, j) covers [i, i+1) x [j, j+1).
struct Camera {
  Eigen::Vector3f centre = Eigen::Vector3f::Zero();    ///< The point in the middle of the picture.
  Eigen::Vector3f towards = Eigen::Vector3f::UnitZ();  ///< Unit, from the scene to the viewer.
  Eigen::Vector3f right = Eigen::Vector3f::UnitX();
  Eigen::Vector3f up = Eigen::Vector3f::UnitY();
  int width = 0, height = 0;
  float mm_per_pixel = 1;
  float near_mm =
      0;  ///< The picture plane stands this far in front of the centre; nothing before it is seen.

  /// Where a point appears: column, row (in pixels) and depth behind the picture plane (mm).
  Eigen::Vector3f project(const Eigen::Vector3f& point) const {
    const Eigen::Vector3f d = point - centre;
    return {0.5f * width + d.dot(right) / mm_per_pixel, 0.5f * height - d.dot(up) / mm_per_pixel,
            near_mm - d.dot(towards)};
  }
  /// The point of the scene that `project` sends there.
  Eigen::Vector3f unproject(float column, float row, float depth) const {
    return centre + (column - 0.5f * width) * mm_per_pixel * right +
           (0.5f * height - row) * mm_per_pixel * up + (near_mm - depth) * towards;
  }
};

struct NamedCamera {
  std::string name;
  Camera camera;
};

/// Six views that show a part from every side, each fitted to its picture: three isometric ones (two
/// opposite from above, one from below), the two opposite sides with the most surface, and the top.
std::vector<NamedCamera> overview_cameras(const TriangleMesh& mesh);

/// Four views from alternate corners of a cube, which together show all that can be seen from outside.
std::vector<NamedCamera> coverage_cameras(const TriangleMesh& mesh);

/// Looks straight at a defect's peak, from the side to which `facing` points, wide enough for the region.
Camera close_up_camera(const Defect& defect, const Eigen::Vector3f& facing, const RayScene& scene);

}  // namespace gantry::report
