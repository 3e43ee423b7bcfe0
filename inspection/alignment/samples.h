#pragma once

#include <cstdint>
#include <vector>

#include "alignment/fit_frame.h"
#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/signed_distance.h"

namespace gantry::internal {

/// The points of a cloud that an alignment uses, in the cloud's frame.
struct AlignmentSamples {
  PointCloud cloud;
  std::vector<double> weight;                     ///< See sample_weights().
  std::vector<std::vector<uint32_t>> neighbours;  ///< The nearest other samples of each, both ways.
};

/// 1 / sigma^2, scaled to 1 in the median; all 1 for a cloud without sigma. Sigma counts within a factor of
/// four of its median: one point may count for many, but not for all.
std::vector<double> sample_weights(const PointCloud& cloud);

/// Evenly spread: every n-th point along a Morton curve.
AlignmentSamples choose_samples(const PointCloud& cloud, size_t count);

/// A sample and the face of the model that it lies on, in the CAD frame.
struct Pair {
  Eigen::Vector3d point, normal;
  double distance = 0;  ///< Signed, to the plane of the face.
  int triangle = -1;    ///< The guess for the next search while not found.
  bool found = false;
};

/// Pairs every sample with the closest face within `reach_mm` that faces the same way.
void find_pairs(const PointCloud& samples, const SignedDistance& model, const Pose& cad_from_cloud,
                double reach_mm, double min_cosine, std::vector<Pair>& pairs);

/// Centre and radius of gyration of the points.
FitFrame frame_of(const std::vector<Eigen::Vector3d>& points);

/// 1.4826 times the median magnitude (0 for none): sigma, as far as most values are normal.
double robust_sigma(std::vector<double> values);

}  // namespace gantry::internal
