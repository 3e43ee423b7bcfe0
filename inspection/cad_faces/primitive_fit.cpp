#include "cad_faces/primitive_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "alignment/tessellation.h"

namespace gantry::internal {
namespace {

constexpr double kLargestRadiusMm = 1e5;

/// Eigenvector of the smallest eigenvalue; the middle one must be away from it, or there is no direction.
std::optional<Eigen::Vector3d> least_direction(const Eigen::Matrix3d& symmetric, double least_ratio) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(symmetric);
  const Eigen::Vector3d values = solver.eigenvalues();
  if (!(values[2] > 0) || values[1] < least_ratio * values[2]) return std::nullopt;
  return solver.eigenvectors().col(0);
}

struct Round {
  Eigen::VectorXd centre;
  double radius;
};

/// Circle or sphere through points about their mean, by linear least squares: |p|^2 = 2 c p + d.
template <int N>
std::optional<Round> fit_round(const std::vector<Eigen::Matrix<double, N, 1>>& points) {
  using Point = Eigen::Matrix<double, N, 1>;
  using Row = Eigen::Matrix<double, N + 1, 1>;
  Point mean = Point::Zero();
  for (const Point& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix<double, N + 1, N + 1> normal = Eigen::Matrix<double, N + 1, N + 1>::Zero();
  Row right = Row::Zero();
  double scale = 0;
  for (const Point& p : points) scale = std::max(scale, (p - mean).norm());
  if (!(scale > 0)) return std::nullopt;
  for (const Point& p : points) {
    const Point d = (p - mean) / scale;
    Row row;
    row << 2 * d, 1;
    normal += row * row.transpose();
    right += d.squaredNorm() * row;
  }
  const Eigen::LDLT<Eigen::Matrix<double, N + 1, N + 1>> solver(normal);
  if (solver.info() != Eigen::Success || solver.rcond() < 1e-12) return std::nullopt;
  const Row solution = solver.solve(right);
  const Point centre = solution.template head<N>();
  const double squared = solution[N] + centre.squaredNorm();
  if (!(squared > 0) || std::sqrt(squared) * scale > kLargestRadiusMm) return std::nullopt;
  return Round{mean + scale * centre, scale * std::sqrt(squared)};
}

std::optional<CadSurface> fit_cylinder(const std::vector<Flat>& flats, std::span<const int> members) {
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  double area = 0;
  for (const int f : members) {
    spread += flats[f].area_mm2 * flats[f].normal * flats[f].normal.transpose();
    middle += flats[f].area_mm2 * flats[f].centroid;
    area += flats[f].area_mm2;
  }
  middle /= area;
  const auto axis = least_direction(spread, 1e-5);
  if (!axis) return std::nullopt;
  const Eigen::Vector3d u = axis->unitOrthogonal(), v = axis->cross(u);
  std::vector<Eigen::Vector2d> points;
  for (const int f : members)
    for (const Eigen::Vector3d& p : flats[f].corners)
      points.emplace_back(u.dot(p - middle), v.dot(p - middle));
  const auto circle = fit_round<2>(points);
  if (!circle) return std::nullopt;
  CadSurface surface;
  surface.kind = SurfaceKind::kCylinder;
  surface.axis = *axis;
  surface.point = middle + circle->centre[0] * u + circle->centre[1] * v;
  surface.radius_mm = circle->radius;
  return surface;
}

/// The planes of all facets of a cone pass through its apex; its edges all leave there at one angle to the
/// axis.
std::optional<CadSurface> fit_cone(const std::vector<Flat>& flats, std::span<const int> members) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero(), middle = Eigen::Vector3d::Zero();
  double area = 0;
  for (const int f : members) {
    middle += flats[f].area_mm2 * flats[f].centroid;
    area += flats[f].area_mm2;
  }
  middle /= area;
  for (const int f : members) {
    const Flat& flat = flats[f];
    normal += flat.area_mm2 * flat.normal * flat.normal.transpose();
    right += flat.area_mm2 * flat.normal * flat.normal.dot(flat.centroid - middle);
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> check(normal, Eigen::EigenvaluesOnly);
  if (check.eigenvalues()[0] < 1e-8 * check.eigenvalues()[2]) return std::nullopt;  // a cylinder, a plane
  CadSurface surface;
  surface.kind = SurfaceKind::kCone;
  surface.point = middle + Eigen::Vector3d(normal.ldlt().solve(right));
  if (!((surface.point - middle).norm() < kLargestRadiusMm)) return std::nullopt;
  std::vector<Eigen::Vector3d> edges;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const int f : members)
    for (const Eigen::Vector3d& p : flats[f].corners) {
      const Eigen::Vector3d d = p - surface.point;
      if (d.norm() < 1e-6) continue;  // the apex itself
      edges.push_back(d.normalized());
      mean += edges.back();
    }
  if (edges.size() < 4) return std::nullopt;
  mean /= static_cast<double>(edges.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& e : edges) spread += (e - mean) * (e - mean).transpose();
  const auto axis = least_direction(spread, 1e-7);
  if (!axis) return std::nullopt;
  surface.axis = axis->dot(mean) < 0 ? Eigen::Vector3d(-*axis) : *axis;
  surface.half_angle_rad = std::acos(std::clamp(surface.axis.dot(mean), -1.0, 1.0));
  constexpr double kBlunt = 1.55, kSharp = 0.005;
  if (surface.half_angle_rad > kBlunt || surface.half_angle_rad < kSharp) return std::nullopt;
  return surface;
}

std::optional<CadSurface> fit_sphere(const std::vector<Flat>& flats, std::span<const int> members) {
  std::vector<Eigen::Vector3d> points;
  for (const int f : members) points.insert(points.end(), flats[f].corners.begin(), flats[f].corners.end());
  const auto round = fit_round<3>(points);
  if (!round) return std::nullopt;
  CadSurface surface;
  surface.kind = SurfaceKind::kSphere;
  surface.point = round->centre;
  surface.radius_mm = round->radius;
  return surface;
}

}  // namespace

std::optional<CadSurface> fit_surface(SurfaceKind kind, const std::vector<Flat>& flats,
                                      std::span<const int> members) {
  std::optional<CadSurface> surface;
  if (kind == SurfaceKind::kCylinder) surface = fit_cylinder(flats, members);
  if (kind == SurfaceKind::kCone) surface = fit_cone(flats, members);
  if (kind == SurfaceKind::kSphere) surface = fit_sphere(flats, members);
  if (!surface) return std::nullopt;
  double outwards = 0;
  for (const int f : members)
    outwards += flats[f].area_mm2 * flats[f].normal.dot(surface->normal_at(flats[f].centroid));
  surface->hollow = outwards < 0;
  return surface;
}

bool lies_on(const CadSurface& surface, const Flat& flat, double tolerance_mm) {
  for (const Eigen::Vector3d& p : flat.corners)
    if (!(std::abs(surface.distance(p)) <= tolerance_mm)) return false;
  if (surface.normal_at(flat.centroid).dot(flat.normal) < std::cos(kSmooth_rad)) return false;
  // A chord of a smooth surface turns by less than kSmooth_rad: it sags by less than r (1 - cos(half of it)).
  const double local_radius = surface.kind == SurfaceKind::kCone
                                  ? (flat.centroid - surface.point).norm() * std::tan(surface.half_angle_rad)
                                  : surface.radius_mm;
  return std::abs(surface.distance(flat.centroid)) <=
         tolerance_mm + local_radius * (1 - std::cos(kSmooth_rad / 2));
}

}  // namespace gantry::internal
