#include "distances/local_model.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <cmath>

#include "distances/delaunay.h"
#include "gantry/geometry/closest_on_triangle.h"

namespace gantry::internal {
namespace {

using Points = std::span<const Eigen::Vector3d>;

/// The least-squares plane as a frame: the third axis is its normal.
struct PlaneFrame {
  Eigen::Vector3d origin;
  Eigen::Matrix3d axes;  ///< Columns.
  double size = 0;       ///< Standard deviation of the points along the first.

  Eigen::Vector3d local(const Eigen::Vector3d& p) const { return axes.transpose() * (p - origin); }
};

std::optional<PlaneFrame> plane_frame(Points points) {
  if (points.size() < 3) return std::nullopt;
  PlaneFrame frame{Eigen::Vector3d::Zero(), {}, 0};
  const auto n = static_cast<double>(points.size());
  for (const auto& p : points) frame.origin += p / n;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const auto& p : points) covariance += (p - frame.origin) * (p - frame.origin).transpose() / n;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  const Eigen::Vector3d variances = solver.eigenvalues();  // rising
  constexpr double kLeastRatio = 1e-6;                     // of the standard deviations across and along
  if (!(variances[1] > kLeastRatio * kLeastRatio * variances[2])) return std::nullopt;
  frame.axes = solver.eigenvectors().rowwise().reverse();
  frame.size = std::sqrt(variances[2]);
  return frame;
}

/// The terms of the quadratic; u, v in units of the patch's size, lest squares outweigh the constant.
Eigen::Matrix<double, 1, 6> quadratic_terms(const Eigen::Vector3d& local, double size) {
  const double u = local.x() / size, v = local.y() / size;
  return {1, u, v, u * u, u * v, v * v};
}

}  // namespace

std::optional<double> distance_to_plane(Points neighbours, const Eigen::Vector3d& point) {
  const auto frame = plane_frame(neighbours);
  if (!frame) return std::nullopt;
  return std::abs(frame->local(point).z());
}

std::optional<double> distance_to_quadric(Points neighbours, const Eigen::Vector3d& point) {
  constexpr auto kMost = static_cast<int>(kMostNeighbours);
  const auto frame = plane_frame(neighbours);
  if (!frame || neighbours.size() < 6) return std::nullopt;
  const auto n = static_cast<Eigen::Index>(neighbours.size());
  Eigen::Matrix<double, Eigen::Dynamic, 6, 0, kMost, 6> terms(n, 6);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost, 1> heights(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Vector3d local = frame->local(neighbours[static_cast<size_t>(i)]);
    terms.row(i) = quadratic_terms(local, frame->size);
    heights[i] = local.z();
  }
  const Eigen::ColPivHouseholderQR<decltype(terms)> solver(terms);
  if (solver.rank() < 6) return std::nullopt;
  const Eigen::Matrix<double, 6, 1> coefficients = solver.solve(heights);
  const Eigen::Vector3d local = frame->local(point);
  return std::abs(local.z() - quadratic_terms(local, frame->size) * coefficients);
}

std::optional<double> distance_to_triangulation(Points neighbours, const Eigen::Vector3d& point) {
  const auto frame = plane_frame(neighbours);
  if (!frame) return std::nullopt;
  thread_local std::vector<Eigen::Vector2d> projected;
  thread_local std::vector<std::array<int, 3>> triangles;
  projected.clear();
  for (const auto& p : neighbours) projected.push_back(frame->local(p).head<2>());
  delaunay(projected, triangles);
  std::optional<double> least;
  for (const auto& [a, b, c] : triangles) {
    TriangleFeature feature;
    const double distance =
        (closest_on_triangle(point, neighbours[a], neighbours[b], neighbours[c], feature) - point).norm();
    if (!least || distance < *least) least = distance;
  }
  return least;
}

}  // namespace gantry::internal
