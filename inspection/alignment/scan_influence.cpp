#include "alignment/scan_influence.h"

#include <cmath>

namespace gantry::internal {

std::vector<Matrix6d> scan_influence(const AlignmentSamples& samples, const std::vector<Pair>& pairs,
                                     const std::vector<unsigned char>& masked,
                                     const NormalEquations& equations, const HeldMotions& motions,
                                     const FitFrame& frame) {
  if (!samples.cloud.sources) return {};
  const CloudSources& sources = *samples.cloud.sources;
  std::vector<Matrix6d> parts(sources.scans.size(), Matrix6d::Zero());
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!pairs[i].found || masked[i]) continue;
    const double weight = samples.weight[i];
    const double slope = tukey(pairs[i].distance * std::sqrt(weight) / equations.sigma).slope;
    const Vector6d row = frame.row(pairs[i].point, pairs[i].normal);
    for (const CloudSources::Share& share : sources.of(i))
      parts[share.scan] += weight * slope * share.fraction() * row * row.transpose();
  }
  const Matrix6d to_twist = frame.twist_from_local();
  const Eigen::MatrixXd curvature = motions.held.transpose() * equations.curvature * motions.held;
  const Matrix6d solve =
      to_twist * motions.held * curvature.ldlt().solve(Eigen::MatrixXd(motions.held.transpose()));
  for (Matrix6d& part : parts) part = solve * part * to_twist.inverse();
  return parts;
}

}  // namespace gantry::internal
