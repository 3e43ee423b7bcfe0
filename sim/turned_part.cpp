#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "gantry/sim/parts.h"

namespace gantry {
namespace {

using Eigen::Vector2d;
using std::numbers::pi;

constexpr int kSegments = 720;
constexpr double kShoulderRadius = 40, kShoulderFrom = -17.6, kShoulderTo = 15.6;

/// Radius and height, from the axis at the lower end to the axis at the upper end.
constexpr double kOutline[][2] = {{0, -55},
                                  {24.6, -55},
                                  {25, -54.6},
                                  {25, -21.5},
                                  {24, -21},
                                  {24, -18},
                                  {39.6, -18},
                                  {kShoulderRadius, kShoulderFrom},
                                  {kShoulderRadius, kShoulderTo},
                                  {39.6, 16},
                                  {33, 16},
                                  {32, 17},
                                  {32, 24},
                                  {29, 24.2},
                                  {29, 29.8},
                                  {32, 30},
                                  {32, 33.6},
                                  {31.6, 34},
                                  {18.3, 54.6},
                                  {17.8, 55},
                                  {0, 55}};

/// The outline with points no more than `step_mm` of height apart; faces across the axis stay whole.
std::vector<Vector2d> outline_points(double step_mm) {
  std::vector<Vector2d> points = {{kOutline[0][0], kOutline[0][1]}};
  for (size_t i = 1; i < std::size(kOutline); ++i) {
    const Vector2d from(kOutline[i - 1][0], kOutline[i - 1][1]), to(kOutline[i][0], kOutline[i][1]);
    const int steps = std::max(1, static_cast<int>(std::ceil(std::abs(to.y() - from.y()) / step_mm)));
    for (int k = 1; k <= steps; ++k) points.push_back(from + (to - from) * k / steps);
  }
  return points;
}

/// Height of the bumps over the shoulder.
double bump_mm(double angle, double z) {
  constexpr double kHeight = 1.5, kHalfWidth = 5;
  for (const auto& [degrees, centre_z] : {std::pair{0.0, -4.0}, {100.0, 4.0}, {220.0, -1.0}}) {
    const double across = kShoulderRadius * std::remainder(angle - degrees * pi / 180, 2 * pi);
    const double share = std::hypot(across, z - centre_z) / kHalfWidth;
    if (share < 1) return kHeight * std::pow(1 - share * share, 2);
  }
  return 0;
}

double radius_with(RevolvedFeature feature, double radius, double angle, double z) {
  if (feature == RevolvedFeature::kBumps && radius == kShoulderRadius) return radius + bump_mm(angle, z);
  if (feature == RevolvedFeature::kFlat && std::cos(angle) > 0) {
    const double flat_x = std::sqrt(kShoulderRadius * kShoulderRadius - 12.5 * 12.5);
    return std::min(radius, flat_x / std::cos(angle));
  }
  return radius;
}

}  // namespace

TriangleMesh make_revolved_part(RevolvedFeature feature) {
  TriangleMesh mesh;
  std::vector<std::array<int, kSegments>> rings;
  for (const Vector2d& point : outline_points(0.8)) {
    std::array<int, kSegments>& ring = rings.emplace_back();
    for (int s = 0; s < kSegments; ++s) {
      if (point.x() == 0 && s > 0) {  // a point of the axis is a ring of one vertex
        ring[s] = ring[0];
        continue;
      }
      const double angle = 2 * pi * s / kSegments;
      const double radius = radius_with(feature, point.x(), angle, point.y());
      ring[s] = static_cast<int>(mesh.vertices.size());
      mesh.vertices.push_back(
          Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), point.y()).cast<float>());
    }
  }
  for (size_t i = 0; i + 1 < rings.size(); ++i) {
    for (int s = 0; s < kSegments; ++s) {
      const int next = (s + 1) % kSegments;
      const int a = rings[i][s], b = rings[i][next], c = rings[i + 1][next], d = rings[i + 1][s];
      if (a != b) mesh.triangles.emplace_back(a, b, c);
      if (c != d) mesh.triangles.emplace_back(a, c, d);
    }
  }
  return mesh;
}

}  // namespace gantry
