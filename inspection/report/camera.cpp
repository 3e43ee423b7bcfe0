#include "report/camera.h"

#include <algorithm>
#include <cmath>

namespace gantry::report {
namespace {

constexpr int kOverviewWidth = 880, kOverviewHeight = 640;
constexpr int kOverviewMargin = 56;  // pixels, room for labels
constexpr int kCloseUpWidth = 480, kCloseUpHeight = 360;
constexpr float kCloseUpMm = 36;   // across the picture, unless the defect is larger
constexpr float kStandOffMm = 30;  // of the close-up's picture plane

/// Turns the camera to look from `towards` with z upright, or with y upright for a view along z.
void aim(Camera& camera, const Eigen::Vector3f& towards) {
  camera.towards = towards.normalized();
  const Eigen::Vector3f upright = std::abs(camera.towards.z()) > 0.95f
                                      ? Eigen::Vector3f(Eigen::Vector3f::UnitY())
                                      : Eigen::Vector3f::UnitZ();
  camera.right = upright.cross(camera.towards).normalized();
  camera.up = camera.towards.cross(camera.right);
}

Camera fitted_camera(const TriangleMesh& mesh, const Eigen::Vector3f& towards, int width = kOverviewWidth,
                     int height = kOverviewHeight) {
  Camera camera;
  camera.width = width;
  camera.height = height;
  aim(camera, towards);
  Eigen::AlignedBox3f box;  // in the camera's axes
  for (const auto& triangle : mesh.triangles)
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3f& v = mesh.vertices[triangle[k]];
      box.extend(Eigen::Vector3f(v.dot(camera.right), v.dot(camera.up), v.dot(camera.towards)));
    }
  const Eigen::Vector3f middle = box.center(), size = box.sizes();
  camera.centre = middle.x() * camera.right + middle.y() * camera.up + middle.z() * camera.towards;
  camera.mm_per_pixel = std::max({size.x() / (camera.width - 2 * kOverviewMargin),
                                  size.y() / (camera.height - 2 * kOverviewMargin), 1e-6f});
  // Room before the part for material that the CAD model does not have.
  camera.near_mm = 0.5f * size.z() + 0.1f * mesh.bounds().diagonal().norm() + 1;
  return camera;
}

/// Area that a viewer on this side would see if nothing hid anything.
double facing_area(const TriangleMesh& mesh, const Eigen::Vector3f& towards) {
  double sum = 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t)
    sum += mesh.area(t) * std::max(0.0f, mesh.normal(t).dot(towards));
  return sum;
}

/// "+x", "−y": the direction from which one looks.
std::string axis_text(float sign, char axis) {
  return std::string(sign > 0 ? "+" : "\u2212") + axis;
}

/// 30 degrees of elevation for a part that stands, like the drawing office's isometric view.
NamedCamera isometric(const TriangleMesh& mesh, float sx, float sy, float sz, int width = kOverviewWidth,
                      int height = kOverviewHeight) {
  const std::string from = axis_text(sx, 'x') + " " + axis_text(sy, 'y') + " " + axis_text(sz, 'z');
  return {std::string("Isometric from ") + (sz > 0 ? "above" : "below") + " (" + from + ")",
          fitted_camera(mesh, {sx, sy, 0.82f * sz}, width, height)};
}

}  // namespace

std::vector<NamedCamera> overview_cameras(const TriangleMesh& mesh) {
  const Eigen::Vector3f x = Eigen::Vector3f::UnitX(), y = Eigen::Vector3f::UnitY(),
                        z = Eigen::Vector3f::UnitZ();
  const bool along_x =
      facing_area(mesh, x) + facing_area(mesh, -x) >= facing_area(mesh, y) + facing_area(mesh, -y);
  const Eigen::Vector3f side = along_x ? x : y;
  const char axis = along_x ? 'x' : 'y';
  return {isometric(mesh, 1, -1, 1),
          isometric(mesh, -1, 1, 1),
          isometric(mesh, 1, 1, -1),
          {"Side, seen from " + axis_text(1, axis), fitted_camera(mesh, side)},
          {"Side, seen from " + axis_text(-1, axis), fitted_camera(mesh, -side)},
          {"Top, seen from +z", fitted_camera(mesh, z)}};
}

std::vector<NamedCamera> coverage_cameras(const TriangleMesh& mesh) {
  constexpr int kWidth = 600, kHeight = 430;
  return {isometric(mesh, 1, -1, 1, kWidth, kHeight), isometric(mesh, -1, 1, 1, kWidth, kHeight),
          isometric(mesh, 1, 1, -1, kWidth, kHeight), isometric(mesh, -1, -1, -1, kWidth, kHeight)};
}

Camera close_up_camera(const Defect& defect, const Eigen::Vector3f& facing, const RayScene& scene) {
  Camera camera;
  camera.width = kCloseUpWidth;
  camera.height = kCloseUpHeight;
  aim(camera, facing);
  const Eigen::Vector3f peak = defect.peak_at_mm.cast<float>(), extent = defect.extent_mm.cast<float>();
  // The bounding box as it appears in the picture.
  const float across = extent.dot(camera.right.cwiseAbs()), along = extent.dot(camera.up.cwiseAbs());
  const float aspect = static_cast<float>(kCloseUpWidth) / kCloseUpHeight;
  const float needed = 1.25f * std::max(across, along * aspect);
  camera.mm_per_pixel = std::max(kCloseUpMm, needed) / kCloseUpWidth;
  // A region that outgrows the usual picture is shown whole, a small one with its peak in the middle.
  camera.centre = needed > kCloseUpMm ? defect.centre_mm.cast<float>() : peak;
  camera.centre += (peak - camera.centre).dot(camera.towards) * camera.towards;
  // What stands before the defect (the other leg of a U) must not hide it.
  const Eigen::Vector3f start =
      peak + (1.0f + 2 * static_cast<float>(std::abs(defect.peak_mm))) * camera.towards;
  const auto hit = scene.cast(start, camera.towards, kStandOffMm);
  camera.near_mm = hit ? std::max(0.9f * hit->distance, 0.5f) + (start - peak).norm() : kStandOffMm;
  return camera;
}

}  // namespace gantry::report
