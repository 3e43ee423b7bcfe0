#pragma once

#include <span>
#include <utility>
#include <vector>

#include "gantry/fusion/range_surface.h"
#include "joint/coarse.h"
#include "joint/edge_matches.h"
#include "joint/matches.h"
#include "joint/normal_equations.h"
#include "joint/tag_prior.h"

namespace gantry::internal {

/// Of each scan, in the coarse stages.
constexpr size_t kCoarseSamples = 200;

/// All that the stages of the joint method share.
struct JointProblem {
  std::span<const RangeSurface> scans;
  /// Thinned 16 and 8 fold, or less where scans are small; spacings in mm.
  std::vector<CoarseLevel> coarse_levels, medium_levels;
  double coarse_mm = 0, medium_mm = 0;
  CoarseScans coarse, medium;
  std::vector<EdgeIndex> edges;
  TagPrior tag_prior;                                ///< Of all poses together.
  std::vector<PosePrior> priors;                     ///< Of each alone, for the coarse stages.
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< Of the part: errors are twists about it.
  double radius_mm = 1;                              ///< Of the part about its centre.
  double noise_mm = 0, spacing_mm = 0;               ///< Medians over the scans.
  double normal_variance = 0;                        ///< By which noise tilts a match's normal, rad^2.
  size_t max_partners = 16;

  size_t size() const { return scans.size(); }
  /// Of samples that each pair may take so that the time grows with the number of scans, not its square.
  double share_of_pair() const {
    return std::min(1.0, static_cast<double>(max_partners) / static_cast<double>(size()));
  }
  /// So many scans that work on a few of them must not be repeated for all.
  bool many() const { return size() > 32; }
  /// Of samples of a scan that do where there are many: it has more partners than in a small set.
  size_t samples(size_t of_few) const { return many() ? of_few * 2 / 5 : of_few; }
  // Where one stage ends and the next begins: what nearest points of a level can tell of its spacing.
  double coarse_end_mm() const { return 0.7 * coarse_mm; }
  double medium_end_mm() const { return 0.55 * medium_mm; }
  double fine_start_mm() const { return 0.7 * medium_mm; }
};

/// Pairs that share surface at these poses, at most `max_partners` for each scan but always enough to
/// connect what can be connected.
Pairs pairs_with_overlap(const JointProblem& problem, const Poses& poses, double tolerance_mm);

/// How far each pose is from its tag: errors about the centre, 6 rows a scan.
Eigen::VectorXd errors_of_tags(const JointProblem& problem, const Poses& poses);

/// Applies a step to all poses; returns the largest displacement of any scan, at the part's radius.
double apply_step(const JointProblem& problem, const Eigen::VectorXd& step, Poses& poses);

/// How far two sets of poses put the scans apart, at the part's radius, once scan 0 lies at the same place.
double difference_mm(const JointProblem& problem, const Poses& a, const Poses& b);

}  // namespace gantry::internal
