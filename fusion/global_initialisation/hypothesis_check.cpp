#include "global_initialisation/hypothesis_check.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

constexpr size_t kSamples = 300;  // source points used while aligning
constexpr double kCountGateSpacings = 1.5;
constexpr double kTouchingSpacings = 0.5;  // along the normal, where sampling hardly matters
constexpr double kDisagreement = 1.5;
constexpr double kMinNormalCosine = 0.8776;  // 0.5 rad
constexpr size_t kMinInliers = 20;
constexpr double kMinConstraint = 1e-3;    // mean squared slope below which a direction counts as free
constexpr double kBackgroundWeight = 0.5;  // no data beside the surface may also be shadow

double violation(const FreeSpace& seen, const PointCloud& cloud, const Pose& seen_from_cloud) {
  const size_t stride = std::max<size_t>(1, cloud.size() / kSamples);
  double sum = 0;
  size_t count = 0;
  for (size_t i = 0; i < cloud.size(); i += stride, ++count) {
    switch (seen.at(seen_from_cloud * cloud.points[i].cast<double>())) {
      case FreeSpace::Seen::kPossible:
        break;
      case FreeSpace::Seen::kInFront:
        sum += 1;
        break;
      case FreeSpace::Seen::kBackground:
        sum += kBackgroundWeight;
        break;
    }
  }
  return sum / static_cast<double>(count);
}

}  // namespace

HypothesisCheck::HypothesisCheck(const PointCloud& target, const PointCloud& source,
                                 const PointIndex& target_index, double spacing_mm, bool free_space)
    : target_(target), source_(source), target_index_(target_index), spacing_mm_(spacing_mm) {
  source_centre_.setZero();
  for (const auto& p : source.points) source_centre_ += p.cast<double>() / static_cast<double>(source.size());
  double squares = 0;
  for (const auto& p : source.points) squares += (p.cast<double>() - source_centre_).squaredNorm();
  radius_mm_ = std::sqrt(squares / static_cast<double>(source.size()));
  if (free_space) {
    seen_by_target_.emplace(target, spacing_mm);
    seen_by_source_.emplace(source, spacing_mm);
  }
}

HypothesisCheck::Fit HypothesisCheck::fit(const Pose& pose, const Eigen::Vector3d& centre, double gate_mm,
                                          double point_share, size_t stride) const {
  Fit fit;
  Matrix6d hessian = 1e-6 * Matrix6d::Identity();
  Vector6d gradient = Vector6d::Zero();
  std::vector<PointIndex::Neighbour> found;
  for (size_t i = 0; i < source_.size(); i += stride) {
    const Eigen::Vector3d x = pose * source_.points[i].cast<double>();
    target_index_.nearest(x.cast<float>(), 1, static_cast<float>(gate_mm), found);
    if (found.empty()) continue;
    const Eigen::Vector3d normal = target_.normals[found[0].index].cast<double>();
    if (normal.dot(pose.linear() * source_.normals[i].cast<double>()) < kMinNormalCosine) continue;
    const Eigen::Vector3d difference = target_.points[found[0].index].cast<double>() - x;
    // Rotations about the centre, measured by the path of a point at the part's radius.
    const Eigen::Vector3d arm = (x - centre) / radius_mm_;
    Vector6d plane;
    plane << arm.cross(normal), normal;
    Eigen::Matrix<double, 3, 6> point;
    point << -cross_matrix(arm), Eigen::Matrix3d::Identity();
    fit.planes += plane * plane.transpose();
    hessian += point_share * point.transpose() * point;
    gradient += plane * normal.dot(difference) + point_share * point.transpose() * difference;
    ++fit.count;
    const double off_plane = normal.dot(difference) / (kTouchingSpacings * spacing_mm_);
    fit.touching += std::abs(off_plane) < 1;
    fit.agreement += 1 - kDisagreement * std::min(1.0, off_plane * off_plane);
  }
  fit.motion = (hessian + fit.planes).ldlt().solve(gradient);
  return fit;
}

double HypothesisCheck::free_space_violation(const Pose& pose) const {
  if (!seen_by_target_) return 0;
  return violation(*seen_by_target_, source_, pose) + violation(*seen_by_source_, target_, pose.inverse());
}

std::optional<CheckedHypothesis> HypothesisCheck::check(const Pose& target_from_source,
                                                        const AlignmentSteps& steps) const {
  CheckedHypothesis checked;
  Pose& pose = checked.target_from_source;
  pose = target_from_source;
  const size_t stride = std::max<size_t>(1, source_.size() / kSamples);
  for (int iteration = 0; iteration < steps.iterations; ++iteration) {
    const Eigen::Vector3d centre = pose * source_centre_;
    const Fit step = fit(pose, centre, steps.gate_spacings * spacing_mm_, steps.point_share, stride);
    if (step.count < 6) return std::nullopt;
    Pose motion = Pose::Identity();
    motion.linear() = rotation_exp(step.motion.head<3>() / radius_mm_);
    motion.translation() = centre + step.motion.tail<3>() - motion.linear() * centre;
    pose = motion * pose;
  }
  pose.linear() = Eigen::Quaterniond(pose.linear()).normalized().toRotationMatrix();
  const Fit last = fit(pose, pose * source_centre_, kCountGateSpacings * spacing_mm_, 0, 1);
  if (last.count < kMinInliers) return std::nullopt;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> constraint(last.planes / static_cast<double>(last.count),
                                                           Eigen::EigenvaluesOnly);
  if (constraint.eigenvalues()[2] < kMinConstraint) return std::nullopt;
  checked.inliers = last.touching;
  checked.score = last.agreement / static_cast<double>(source_.size()) - free_space_violation(pose);
  return checked;
}

}  // namespace gantry
