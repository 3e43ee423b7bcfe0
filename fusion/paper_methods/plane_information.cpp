#include "paper_methods/plane_information.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

constexpr double kNoiseShare = 0.02;
/// Eigenvalues this far below the greatest are rounding.
constexpr double kRounding = 1e-10;

Vector6d constraint(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) {
  Vector6d j;
  j << point.cross(normal), normal;
  return j;
}

}  // namespace

Matrix6d plane_information(const std::vector<PlaneContact>& contacts) {
  double weights = 0;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const PlaneContact& c : contacts) {
    centre += c.weight * c.point;
    weights += c.weight;
  }
  if (!(weights > 0)) return Matrix6d::Zero();
  centre /= weights;
  double squares = 0;
  for (const PlaneContact& c : contacts) squares += c.weight * (c.point - centre).squaredNorm();
  // Rotations about the centre in units of this lever have the same size as shifts: eigenvalues compare.
  const double lever_mm = std::max(1e-9, std::sqrt(squares / weights));

  Matrix6d mixed = Matrix6d::Zero(), noise = Matrix6d::Zero();
  for (const PlaneContact& c : contacts) {
    const Eigen::Vector3d p = (c.point - centre) / lever_mm;
    const Vector6d a = constraint(p, c.normal_a), b = constraint(p, c.normal_b);
    mixed += 0.5 * c.weight * (a * b.transpose() + b * a.transpose());
    noise += 0.5 * c.weight * (a - b) * (a - b).transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(mixed - kNoiseShare * noise);
  const double limit = kRounding * weights;
  const Vector6d known =
      solver.eigenvalues().unaryExpr([&](double value) { return value > limit ? value : 0.0; });
  const Matrix6d scaled = solver.eigenvectors() * known.asDiagonal() * solver.eigenvectors().transpose();

  // A motion e about the origin is, about the centre: the same rotation, and shift v + w x centre.
  Matrix6d scaled_from_motion = Matrix6d::Zero();
  scaled_from_motion.topLeftCorner<3, 3>() = lever_mm * Eigen::Matrix3d::Identity();
  scaled_from_motion.bottomLeftCorner<3, 3>() = -cross_matrix(centre);
  scaled_from_motion.bottomRightCorner<3, 3>().setIdentity();
  const Matrix6d information = scaled_from_motion.transpose() * scaled * scaled_from_motion;
  return 0.5 * (information + information.transpose());
}

}  // namespace gantry
