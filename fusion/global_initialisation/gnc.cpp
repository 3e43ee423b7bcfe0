#include "global_initialisation/gnc.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace gantry {
namespace {

constexpr double kGrowth = 1.4;  // of the control parameter mu, as in the paper
constexpr int kMaxIterations = 100;

/// The weighted least squares transform; false when the weights leave nothing to fit.
bool weighted_fit(std::span<const OrientedMatch> matches, const std::vector<double>& weights, double lever_mm,
                  Pose& target_from_source) {
  double sum = 0;
  Eigen::Vector3d target_mean = Eigen::Vector3d::Zero(), source_mean = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < matches.size(); ++i) {
    sum += weights[i];
    target_mean += weights[i] * matches[i].target;
    source_mean += weights[i] * matches[i].source;
  }
  if (!(sum > 1e-9)) return false;
  target_mean /= sum;
  source_mean /= sum;
  Eigen::Matrix3d correlation = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < matches.size(); ++i) {
    const auto& m = matches[i];
    correlation += weights[i] * ((m.target - target_mean) * (m.source - source_mean).transpose() +
                                 lever_mm * lever_mm * m.target_normal * m.source_normal.transpose());
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs(1, 1, 1);
  if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0) signs.z() = -1;
  target_from_source.linear() = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  target_from_source.translation() = target_mean - target_from_source.linear() * source_mean;
  return true;
}

double squared_residual(const OrientedMatch& m, const Pose& pose, double lever_mm) {
  return (m.target - pose * m.source).squaredNorm() +
         lever_mm * lever_mm * (m.target_normal - pose.linear() * m.source_normal).squaredNorm();
}

}  // namespace

GncResult align_by_gnc(std::span<const OrientedMatch> matches, double noise_bound_mm, double lever_mm) {
  GncResult result;
  if (matches.size() < 3) return result;
  const double bound2 = noise_bound_mm * noise_bound_mm;
  std::vector<double> weights(matches.size(), 1.0), residuals(matches.size());
  Pose& pose = result.target_from_source;
  double mu = 0, previous_cost = -1;
  for (int iteration = 0; iteration < kMaxIterations && weighted_fit(matches, weights, lever_mm, pose);
       ++iteration) {
    double largest = 0;
    for (size_t i = 0; i < matches.size(); ++i) {
      residuals[i] = squared_residual(matches[i], pose, lever_mm);
      largest = std::max(largest, residuals[i]);
    }
    if (iteration == 0) {
      if (largest <= bound2) break;          // all are inliers: least squares it is
      mu = bound2 / (2 * largest - bound2);  // paper, remark 5: convex at the start
    }
    // Paper, equation 14: 1 below the transition, 0 above, and a slope that steepens as mu grows.
    const double upper = (mu + 1) / mu * bound2, lower = mu / (mu + 1) * bound2;
    double cost = 0;
    for (size_t i = 0; i < matches.size(); ++i) {
      if (residuals[i] >= upper)
        weights[i] = 0;
      else if (residuals[i] <= lower)
        weights[i] = 1;
      else
        weights[i] = std::sqrt(bound2 * mu * (mu + 1) / residuals[i]) - mu;
      cost += weights[i] * residuals[i];
    }
    if (std::abs(cost - previous_cost) < 1e-9 * bound2) break;
    previous_cost = cost;
    mu *= kGrowth;
  }
  for (size_t i = 0; i < matches.size(); ++i)
    if (squared_residual(matches[i], pose, lever_mm) <= bound2) result.inliers.push_back(i);
  return result;
}

}  // namespace gantry
