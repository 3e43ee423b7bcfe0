#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "gantry/fusion/preprocess.h"
#include "gantry/geometry/point_index.h"

namespace gantry {

/// The paper's two kinds of pairwise registration, by the names of its plugin's menu.
enum class PairwiseMethod {
  /// "Point-To-Plane" (Chen and Medioni 1992): distances along the target's normals.
  kPointToPlane,
  /// "Generalized ICP" (Segal et al. 2009): both surfaces are locally plane with a covariance, and pairs
  /// are weighted by the sum of both.
  kGeneralizedIcp
};

struct PairwiseOptions {
  PairwiseMethod method = PairwiseMethod::kGeneralizedIcp;
  double max_distance_mm = 5;  ///< Search radius at the start: the initial pose's error at the part.
  double min_distance_mm = 0;  ///< Where the radius ends; 0: four times the coarser surface's spacing.
  /// Normals of a pair may differ by this (35 degrees): keeps the faces of a wall apart. pi: any may match,
  /// as in the paper's earlier point-to-plane baseline.
  double max_angle_rad = 0.6109;
  size_t samples = 6000;  ///< Source points used, balanced over the directions of their normals; 0: all.
  /// Source points of a last pass that sets the accuracy: evenly taken from those within reach of the target,
  /// each given its partner once, at the pose found. 0: none; the iterations' points decide.
  size_t final_samples = 0;
  int max_iterations = 60;
};

/// Throws InputError naming the field that is out of range.
void validate(const PairwiseOptions& options);

/// What pairwise registration found.
struct PairwiseResult {
  Pose target_from_source = Pose::Identity();
  /// Inverse covariance of errors exp(e) * target_from_source (target frame), from distances along the
  /// normals alone: what slides has no information. Exactly zero in the three directions of a flat overlap.
  Matrix6d information = Matrix6d::Zero();
  size_t inliers = 0;
  double overlap = 0;         ///< Fraction of the source's samples that found a partner.
  double rms_mm = 0;          ///< Of the inliers' distances along the common normal.
  double normalised_rms = 0;  ///< The same in units of the expected noise: about 1 for a good fit.
  int iterations = 0;
  bool converged = false;
};

/// A surface ready to be matched to: its points with a search index. The surface must outlive it.
class MatchTarget {
 public:
  explicit MatchTarget(const ScanSurface& surface);
  const ScanSurface& surface() const { return surface_; }
  const PointIndex& index() const { return index_; }
  /// False: no point of the surface lies within reach_mm(). Much quicker than a search.
  bool maybe_near(const Eigen::Vector3f& point) const;
  double reach_mm() const { return cell_mm_; }

 private:
  size_t cell_index(const Eigen::Vector3i& cell) const;

  const ScanSurface& surface_;
  PointIndex index_;
  float cell_mm_ = 0;
  Eigen::Vector3f corner_ = Eigen::Vector3f::Zero();
  Eigen::Vector3i cells_ = Eigen::Vector3i::Zero();
  std::vector<bool> occupied_;  // by the surface, or next to a cell that is
};

/// Iterative closest points from an initial pose. Covariances are metric (sensor noise along the normal,
/// point spacing across), pairs whose normals disagree or that lie on the rim of the target are rejected,
/// and the loss is Geman-McClure with a scale that narrows with the search radius down to the noise. While
/// the pose is still wrong, Generalized ICP also blurs both surfaces by the residuals' spread, which
/// gives points some hold across the surface and widens the capture range.
/// Throws InputError for options out of range.
PairwiseResult register_pair(const MatchTarget& target, const ScanSurface& source,
                             const Pose& initial_target_from_source, const PairwiseOptions& options);

/// The same with source points chosen by the caller (see sampling.h); `options.samples` is not used.
PairwiseResult register_pair(const MatchTarget& target, const ScanSurface& source,
                             std::span<const uint32_t> source_points, const Pose& initial_target_from_source,
                             const PairwiseOptions& options);

}  // namespace gantry
