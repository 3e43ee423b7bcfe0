#include "alignment/words.h"

#include <Eigen/SVD>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace gantry::internal {
namespace {

using Basis = Eigen::Matrix<double, 6, Eigen::Dynamic>;

constexpr double kAlong = 0.9998;  // cosine: within a degree

/// Turns an orthonormal basis of directions so that it holds as many axes of coordinates as it can.
Eigen::Matrix3Xd along_axes(const Eigen::Matrix3Xd& directions) {
  Eigen::Matrix3Xd result(3, directions.cols());
  Eigen::Index count = 0;
  const auto add = [&](Eigen::Vector3d v) {
    for (Eigen::Index k = 0; k < count; ++k) v -= result.col(k).dot(v) * result.col(k);
    if (count < directions.cols() && v.norm() > 0.1) result.col(count++) = v.normalized();
  };
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d inside = directions * directions.row(axis).transpose();
    if (inside.norm() > kAlong) add(inside);
  }
  for (Eigen::Index k = 0; k < directions.cols(); ++k) add(directions.col(k));
  return result.leftCols(count);
}

/// The part of a space of motions that does not turn, and directions to turn about for the rest of it.
struct Parts {
  Eigen::Matrix3Xd slides, turns;
  Basis turning;  ///< For each turn its motion, the slides taken out.
};

Parts parts_of(const Basis& free) {
  Parts parts;
  const Eigen::MatrixXd rotations = free.topRows<3>();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(rotations, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Index rank = 0;
  while (rank < svd.singularValues().size() && svd.singularValues()[rank] > 0.05) ++rank;
  parts.slides = along_axes((free * svd.matrixV().rightCols(free.cols() - rank)).bottomRows<3>());
  parts.turns = along_axes(svd.matrixU().leftCols(rank));
  parts.turning.resize(6, parts.turns.cols());
  const Eigen::MatrixXd inverse = svd.matrixV().leftCols(rank) *
                                  svd.singularValues().head(rank).cwiseInverse().asDiagonal() *
                                  svd.matrixU().leftCols(rank).transpose();
  for (Eigen::Index k = 0; k < parts.turns.cols(); ++k) {
    Vector6d motion = free * (inverse * parts.turns.col(k));
    motion.tail<3>() -= parts.slides * (parts.slides.transpose() * motion.tail<3>());
    parts.turning.col(k) = motion;
  }
  return parts;
}

/// "(1.5, 0.0, -2.0)", without a minus before zeros.
std::string triple(const Eigen::Vector3d& v, int decimals) {
  const double unit = std::pow(10, -decimals);
  const auto rounded = [&](double x) { return std::abs(x) < unit / 2 ? 0.0 : x; };
  char text[100];
  std::snprintf(text, sizeof text, "(%.*f, %.*f, %.*f)", decimals, rounded(v.x()), decimals, rounded(v.y()),
                decimals, rounded(v.z()));
  return text;
}

}  // namespace

std::string direction_words(const Eigen::Vector3d& direction) {
  for (int axis = 0; axis < 3; ++axis)
    if (std::abs(direction[axis]) > kAlong) return std::string(direction[axis] < 0 ? "-" : "") + "xyz"[axis];
  return triple(direction, 2);
}

std::vector<FreeMotion> name_free_motions(const HeldMotions& motions, const FitFrame& frame) {
  std::vector<FreeMotion> named;
  if (motions.free.cols() == 0) return named;
  const auto positive = [](const Eigen::Vector3d& v) -> Eigen::Vector3d {
    Eigen::Index most = 0;
    v.cwiseAbs().maxCoeff(&most);
    return v[most] < 0 ? Eigen::Vector3d(-v) : v;
  };
  const Parts parts = parts_of(motions.free);
  for (Eigen::Index k = 0; k < parts.slides.cols(); ++k) {
    FreeMotion motion;
    const Eigen::Vector3d along = positive(parts.slides.col(k));
    motion.twist.tail<3>() = along;
    motion.words = "sliding along " + direction_words(along);
    named.push_back(motion);
  }
  for (Eigen::Index k = 0; k < parts.turns.cols(); ++k) {
    const Vector6d local = parts.turning.col(k);
    const Eigen::Vector3d axis = positive(parts.turns.col(k));
    const Eigen::Vector3d turn = local.head<3>() / frame.lever_mm;
    const Eigen::Vector3d through = frame.centre + turn.cross(local.tail<3>()) / turn.squaredNorm();
    const double advance = local.tail<3>().dot(turn) / turn.squaredNorm();  // mm per rad
    FreeMotion motion;
    motion.twist = frame.twist_from_local() * local / local.norm();
    // Where the part may slide across the axis, the axis has no place.
    if (parts.slides.cols() >= 2 && (axis.transpose() * parts.slides).norm() < 0.1) {
      motion.words = "turning about " + direction_words(axis);
    } else {
      motion.words =
          "turning about the axis along " + direction_words(axis) + " through " + triple(through, 1);
    }
    if (std::abs(advance) > 0.02 * frame.lever_mm) {
      char text[60];
      std::snprintf(text, sizeof text, ", advancing by %.2f mm a turn", 2 * std::numbers::pi * advance);
      motion.words += text;
    }
    named.push_back(motion);
  }
  return named;
}

std::string rotation_words(const Eigen::Matrix3d& rotation) {
  Eigen::Vector3d turn = rotation_log(rotation);
  const double degrees = turn.norm() * 180 / std::numbers::pi;
  if (degrees < 0.5) return "moved";
  Eigen::Vector3d axis = turn.normalized();
  Eigen::Index most = 0;
  axis.cwiseAbs().maxCoeff(&most);
  if (degrees > 179.5 && axis[most] < 0) axis = -axis;
  char text[40];
  std::snprintf(text, sizeof text, "turned by %.0f degrees about ", degrees);
  return text + direction_words(axis);
}

}  // namespace gantry::internal
