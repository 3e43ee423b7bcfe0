#include "gantry/sim/parts.h"

#include <array>
#include <numbers>

#include "implicit_solid.h"

namespace gantry {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// Between two parallel planes.
double slab(double x, double from, double to) {
  return std::max(from - x, x - to);
}

double circle(const Vector2d& p, const Vector2d& centre, double radius) {
  return (p - centre).norm() - radius;
}

/// An axis-parallel rectangle with rounded corners.
double rectangle(const Vector2d& p, const Vector2d& from, const Vector2d& to, double corner_radius) {
  const Vector2d half = 0.5 * (to - from) - Vector2d::Constant(corner_radius);
  const Vector2d outside = (p - 0.5 * (from + to)).cwiseAbs() - half;
  return outside.cwiseMax(0).norm() + std::min(outside.maxCoeff(), 0.0) - corner_radius;
}

/// A bar between two points whose half width changes linearly, with round ends.
double tapered_bar(const Vector2d& p, const Vector2d& from, const Vector2d& to, double half_width_from,
                   double half_width_to) {
  const Vector2d along = to - from;
  const double t = std::clamp((p - from).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (p - from - t * along).norm() - std::lerp(half_width_from, half_width_to, t);
}

double lever(const Vector3d& p) {
  const Vector2d boss_a(-69, -5), elbow(14, -10.5), boss_b(72.5, 9.5);
  const Vector2d flat = p.head<2>();
  const double travel = std::clamp((p.x() - boss_a.x()) / (boss_b.x() - boss_a.x()), 0.0, 1.0);

  // The arm: thinner and higher towards the small boss, sides drafted by 3 degrees from the parting plane.
  const double height = p.z() - std::lerp(-2.0, 2.5, travel);
  const double outline = joined_filleted(tapered_bar(flat, boss_a, elbow, 8.0, 6.5),
                                         tapered_bar(flat, elbow, boss_b, 6.5, 4.5), 3.0);
  double value = common_rounded(outline + std::tan(std::numbers::pi / 60) * std::abs(height),
                                std::abs(height) - std::lerp(5.0, 3.2, travel), 1.0);

  const auto boss = [&](const Vector2d& centre, double radius, double from_z, double to_z) {
    const double drafted = radius - 0.03 * (p.z() - from_z);
    value = joined_filleted(
        value, common_chamfered(circle(flat, centre, drafted), slab(p.z(), from_z, to_z), 0.5), 2.0);
  };
  boss(boss_a, 11.0, -9, 9);
  boss(boss_b, 7.5, -3, 8);

  const double groove =
      common_rounded(tapered_bar(flat, {-48, -6.5}, {0, -9.5}, 3.2, 2.4), 1.8 - height, 1.0);
  value = common_chamfered(value, -groove, 0.5);
  value = common_chamfered(value, -circle(flat, boss_a, 6.0), 0.5);
  return common_chamfered(value, -circle(flat, boss_b, 3.5), 0.5);
}

double block(const Vector3d& p) {
  constexpr double kBreak = 0.6;
  double value = common_rounded(slab(p.x(), -55, 55), slab(p.y(), -40, 40), kBreak);
  value = common_rounded(value, (25 * (p.x() - 55) + 14 * (p.y() - 15)) / std::hypot(25, 14), kBreak);
  value = common_rounded(value, slab(p.z(), -25, 25), kBreak);
  const double step = common_rounded(18 - p.x(), 6 - p.z(), 1.0);
  value = common_rounded(value, -step, kBreak);
  const double pocket = common_rounded(rectangle(p.head<2>(), {-44, -27}, {2, 16}, 6), 11 - p.z(), 1.0);
  value = common_rounded(value, -pocket, kBreak);
  value = common_rounded(value, -circle(p.head<2>(), {36, -19}, 7), kBreak);
  const double blind_hole = std::max(circle({p.x(), p.z()}, {-31, -7}, 9), p.y() + 18);
  return common_rounded(value, -blind_hole, kBreak);
}

double plate(const Vector3d& p) {
  struct Hole {
    Vector2d centre;
    double radius;
  };
  static const std::array<Hole, 5> holes = {
      {{{-32, 17}, 12}, {{36, -22}, 8}, {{-44, -31}, 5}, {{47, 32}, 3}, {{8, 30}, 4}}};
  double outline = rectangle(p.head<2>(), {-60, -45}, {60, 45}, 4);
  for (const Hole& hole : holes) outline = std::max(outline, -circle(p.head<2>(), hole.centre, hole.radius));
  return common_chamfered(outline, slab(p.z(), -1.5, 1.5), 0.5);
}

Eigen::AlignedBox3d box(double half_x, double half_y, double half_z) {
  return {Vector3d(-half_x, -half_y, -half_z), Vector3d(half_x, half_y, half_z)};
}

}  // namespace

TriangleMesh make_slim_lever() {
  return polygonise(lever, box(81, 18, 9), 0.3);
}

TriangleMesh make_prismatic_block() {
  return polygonise(block, box(55, 40, 25), 0.55);
}

TriangleMesh make_plate() {
  return polygonise(plate, box(60, 45, 1.5), 0.4);
}

}  // namespace gantry
