#include <cmath>
#include <limits>

#include "gantry/inspection/cad_faces.h"

namespace gantry {

std::string_view to_string(SurfaceKind kind) {
  switch (kind) {
    case SurfaceKind::kPlane:
      return "plane";
    case SurfaceKind::kCylinder:
      return "cylinder";
    case SurfaceKind::kCone:
      return "cone";
    case SurfaceKind::kSphere:
      return "sphere";
    case SurfaceKind::kFreeform:
      return "freeform";
  }
  return "freeform";
}

double CadSurface::distance(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d d = p - point;
  const double outside = hollow ? -1 : 1;
  switch (kind) {
    case SurfaceKind::kPlane:
      return d.dot(axis);
    case SurfaceKind::kCylinder:
      return outside * ((d - d.dot(axis) * axis).norm() - radius_mm);
    case SurfaceKind::kCone: {
      const double along = d.dot(axis), across = (d - along * axis).norm();
      return outside * (across * std::cos(half_angle_rad) - along * std::sin(half_angle_rad));
    }
    case SurfaceKind::kSphere:
      return outside * (d.norm() - radius_mm);
    case SurfaceKind::kFreeform:
      break;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

Eigen::Vector3d CadSurface::normal_at(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d d = p - point;
  const double outside = hollow ? -1 : 1;
  switch (kind) {
    case SurfaceKind::kPlane:
      return axis;
    case SurfaceKind::kCylinder:
      return outside * (d - d.dot(axis) * axis).stableNormalized();
    case SurfaceKind::kCone: {
      const Eigen::Vector3d across = (d - d.dot(axis) * axis).stableNormalized();
      return outside * (std::cos(half_angle_rad) * across - std::sin(half_angle_rad) * axis);
    }
    case SurfaceKind::kSphere:
      return outside * d.stableNormalized();
    case SurfaceKind::kFreeform:
      break;
  }
  return Eigen::Vector3d::Zero();
}

}  // namespace gantry
