#include "uncertainty/pose_errors.h"

namespace gantry::internal {

PoseErrors::PoseErrors(const CloudSources& sources, const AlignmentResult& alignment) {
  if (sources.pose_covariance.size() == 0) return;
  const auto scans = static_cast<Eigen::Index>(sources.scans.size());
  // Errors in the cloud's frame, to motions against the model.
  const Matrix6d carry = adjoint(alignment.cad_from_cloud);
  Eigen::MatrixXd motions = Eigen::MatrixXd::Zero(6 * scans, 6 * scans);
  for (Eigen::Index k = 0; k < scans; ++k) {
    motions.block<6, 6>(6 * k, 6 * k) = carry;
    if (alignment.scan_influence.empty()) continue;
    const Matrix6d taken_up = alignment.scan_influence[static_cast<size_t>(k)] * carry;
    for (Eigen::Index i = 0; i < scans; ++i) motions.block<6, 6>(6 * i, 6 * k) -= taken_up;
  }
  covariance_ = motions * sources.pose_covariance * motions.transpose();
}

double PoseErrors::variance(std::span<const CloudSources::Share> shares, const Vector6d& row) const {
  if (covariance_.size() == 0) return 0;
  double variance = 0;
  for (const CloudSources::Share& a : shares)
    for (const CloudSources::Share& b : shares)
      variance +=
          a.fraction() * b.fraction() * row.dot(covariance_.block<6, 6>(6 * a.scan, 6 * b.scan) * row);
  return std::max(0.0, variance);
}

}  // namespace gantry::internal
