#include "cad_faces/face_words.h"

#include <cmath>
#include <cstdio>
#include <numbers>

namespace gantry::internal {
namespace {

constexpr double kAlong = 0.9998;  // cosine: within a degree
constexpr double kAllRound_rad = 1.5 * std::numbers::pi;

/// Without a minus before zeros.
std::string number(double value, int decimals = 1) {
  const double unit = std::pow(10, -decimals);
  char text[40];
  std::snprintf(text, sizeof text, "%.*f", decimals, std::abs(value) < unit / 2 ? 0.0 : value);
  return text;
}

std::string triple(const Eigen::Vector3d& v, int decimals) {
  return "(" + number(v.x(), decimals) + ", " + number(v.y(), decimals) + ", " + number(v.z(), decimals) +
         ")";
}

/// 0 to 2 where the direction runs along an axis of coordinates, otherwise -1.
int axis_of(const Eigen::Vector3d& direction) {
  Eigen::Index most;
  return direction.cwiseAbs().maxCoeff(&most) > kAlong ? static_cast<int>(most) : -1;
}

std::string along_at(const Eigen::Vector3d& direction, const Eigen::Vector3d& point) {
  const int axis = axis_of(direction);
  if (axis < 0) return " along " + triple(direction, 2) + " at " + triple(point, 1);
  std::string text = std::string(" along ") + "xyz"[axis] + " at";
  for (int k = 0, told = 0; k < 3; ++k)
    if (k != axis) text += std::string(told++ ? ", " : " ") + "xyz"[k] + " " + number(point[k]);
  return text;
}

}  // namespace

std::string face_words(const CadFace& face) {
  const CadSurface& s = face.surface;
  const bool all_round = face.turn_rad >= kAllRound_rad;
  switch (s.kind) {
    case SurfaceKind::kPlane: {
      const int axis = axis_of(s.axis);
      if (axis < 0) return "plane, normal " + triple(s.axis, 2) + ", through " + triple(face.centre_mm, 1);
      return std::string("plane, normal ") + (s.axis[axis] < 0 ? "-" : "+") + "xyz"[axis] + ", through " +
             "xyz"[axis] + " = " + number(s.point[axis]) + " mm";
    }
    case SurfaceKind::kCylinder: {
      const std::string where = along_at(s.axis, s.point);
      if (all_round)
        return std::string(s.hollow ? "hole" : "boss") + " of " + number(2 * s.radius_mm) + " mm" + where;
      return std::string(s.hollow ? "inside" : "outside") + " rounding of radius " + number(s.radius_mm) +
             " mm" + where;
    }
    case SurfaceKind::kCone:
      return std::string(s.hollow ? "conical hole" : "cone") + (all_round ? "" : ", part of it,") + " of " +
             number(s.half_angle_rad * 360 / std::numbers::pi, 0) + " degrees" + along_at(s.axis, s.point);
    case SurfaceKind::kSphere:
      return std::string(s.hollow ? "spherical hollow" : "sphere") + " of " + number(2 * s.radius_mm) +
             " mm around " + triple(s.point, 1);
    case SurfaceKind::kFreeform:
      break;
  }
  return "freeform surface around " + triple(face.centre_mm, 1);
}

}  // namespace gantry::internal
