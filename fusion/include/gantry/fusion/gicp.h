#pragma once

#include <memory>

#include "gantry/fusion/preprocess.h"
#include "gantry/geometry/point_index.h"

namespace gantry {

struct GicpOptions {
  double max_distance_mm = 5;  ///< Search radius at the start: the initial pose's error at the part.
  double min_distance_mm = 0;  ///< Where the radius ends; 0: four times the target's point spacing.
  double max_angle_rad =
      0.6109;  ///< Normals of a pair may differ by this (35 degrees): keeps the faces of a wall apart.
  size_t samples = 6000;  ///< Source points used, balanced over the directions of their normals.
  int max_iterations = 30;
};

/// What pairwise registration found.
struct GicpResult {
  Pose target_from_source = Pose::Identity();
  Matrix6d information =
      Matrix6d::Zero();  ///< Inverse covariance of errors exp(e) * target_from_source (target frame).
  size_t inliers = 0;
  double overlap = 0;         ///< Fraction of the source's samples that found a partner.
  double rms_mm = 0;          ///< Of the inliers' distances along the common normal.
  double normalised_rms = 0;  ///< The same in units of the expected noise: about 1 for a good fit.
  int iterations = 0;
  bool converged = false;
};

/// A surface ready to be a target of matching: its points with a search index.
class GicpTarget {
 public:
  explicit GicpTarget(const ScanSurface& surface) : surface_(surface), index_(surface.cloud.points) {}
  const ScanSurface& surface() const { return surface_; }
  const PointIndex& index() const { return index_; }

 private:
  const ScanSurface& surface_;
  PointIndex index_;
};

/// Generalized ICP (Segal et al. 2009; the paper, "Refined Pose Graph Registration Algorithm"): both
/// surfaces are locally plane with a covariance, and pairs are weighted by the sum of both. Here the
/// covariances are metric (sensor noise along the normal, point spacing across), pairs whose normals
/// disagree are rejected, matches on the rim of the data too, and the loss is Geman-McClure with a
/// scale that narrows from the search radius to the noise.
GicpResult register_pair(const GicpTarget& target, const ScanSurface& source,
                         const Pose& initial_target_from_source, const GicpOptions& options);

}  // namespace gantry
