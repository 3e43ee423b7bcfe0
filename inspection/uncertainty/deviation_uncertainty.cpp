#include "uncertainty/deviation_uncertainty.h"

#include <cmath>

namespace gantry::internal {
namespace {

/// Across it for each mm of a motion, from which on a free motion moves a surface: about 6 degrees.
constexpr double kAlongItself = 0.1;

/// A free motion slides the part along itself: it counts only where it would move the surface across itself,
/// at a rim for example.
double alignment_variance(const AlignmentResult& alignment, const Vector6d& row) {
  for (const FreeMotion& free : alignment.free_motions)
    if (std::abs(row.dot(free.twist)) > kAlongItself) return row.dot(alignment.covariance * row);
  return row.dot(alignment.held_covariance * row);
}

}  // namespace

DeviationUncertainty::DeviationUncertainty(const PointCloud& cloud, const CloudSources* sources,
                                           const LocalSurface& surface, const AlignmentResult& alignment,
                                           double systematic_sigma_mm)
    : cloud_(cloud),
      sources_(sources),
      surface_(surface),
      alignment_(alignment),
      systematic_variance_(systematic_sigma_mm * systematic_sigma_mm) {
  if (sources_) poses_ = PoseErrors(*sources_, alignment_);
}

UncertaintyBudget DeviationUncertainty::variances(size_t i, const SignedDistance::Value& value) const {
  const Eigen::Vector3d offset = (surface_.points[i] - value.closest).cast<double>();
  const Eigen::Vector3d direction =
      offset.norm() > 1e-6 ? Eigen::Vector3d(offset.normalized()) : value.normal.cast<double>();
  Vector6d row;
  row << value.closest.cast<double>().cross(direction), direction;
  // A point beyond an edge deviates sideways, where nothing was smoothed: there the single point's own
  // counts.
  const double along = cloud_.has_normals() ? direction.dot(cloud_.normals[i].cast<double>()) : 1;
  const double smoothed = surface_.sigma_mm[i], single = cloud_.has_sigma() ? cloud_.sigma_mm[i] : smoothed;
  UncertaintyBudget variances;
  variances.noise = along * along * smoothed * smoothed + (1 - along * along) * single * single;
  variances.alignment = alignment_variance(alignment_, row);
  variances.sensor = systematic_variance_;
  if (!sources_) return variances;
  const auto shares = sources_->of(i);
  variances.scan_poses = poses_.variance(shares, row);
  // Seen from elsewhere, through another part of the lenses, the sensor errs otherwise.
  double squares = 0;
  for (const CloudSources::Share& share : shares) squares += share.fraction() * share.fraction();
  variances.sensor *= squares;
  return variances;
}

}  // namespace gantry::internal
