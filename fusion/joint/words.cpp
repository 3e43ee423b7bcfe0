#include "joint/words.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <numbers>

namespace gantry::internal {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;

std::string direction_in_words(Eigen::Vector3d d) {
  d.normalize();
  // The sign of an axis means nothing: the largest component is shown positive.
  Eigen::Index largest;
  d.cwiseAbs().maxCoeff(&largest);
  if (d[largest] < 0) d *= -1;
  d = (100 * d).array().round() / 100 + 0.0;  // no "-0.00"
  return text("(%.2f, %.2f, %.2f)", d.x(), d.y(), d.z());
}

}  // namespace

std::string text(const char* format, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  va_end(arguments);
  return buffer;
}

std::string observability_in_words(const Matrix6d& covariance, double radius_mm, double limit_mm) {
  Vector6d unit;
  unit << Eigen::Vector3d::Constant(radius_mm), Eigen::Vector3d::Ones();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(unit.asDiagonal() * covariance * unit.asDiagonal());
  std::string words;
  for (int k = 5; k >= 0; --k) {
    const double sigma_mm = std::sqrt(std::max(0.0, solver.eigenvalues()(k)));
    if (sigma_mm <= limit_mm) break;
    const Vector6d motion = solver.eigenvectors().col(k);
    const Eigen::Vector3d turn = motion.head<3>(), slide = motion.tail<3>();
    if (!words.empty()) words += "; ";
    if (turn.norm() > slide.norm()) {
      words += text("turns %.3g deg about ", sigma_mm * turn.norm() / radius_mm * kDegPerRad) +
               direction_in_words(turn);
    } else {
      words += text("slides %.3g mm along ", sigma_mm * slide.norm()) + direction_in_words(slide);
    }
  }
  if (!words.empty()) return words;
  const auto largest = [](const Eigen::Matrix3d& m) {
    return std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m).eigenvalues()(2)));
  };
  return text("fixed within %.2g mm and %.2g deg", largest(covariance.bottomRightCorner<3, 3>()),
              largest(covariance.topLeftCorner<3, 3>()) * kDegPerRad);
}

std::string motion_in_words(const Vector6d& motion, double radius_mm) {
  const Eigen::Vector3d turn = motion.head<3>() * radius_mm, slide = motion.tail<3>();
  return turn.norm() > slide.norm() ? "turning about " + direction_in_words(turn)
                                    : "sliding along " + direction_in_words(slide);
}

}  // namespace gantry::internal
