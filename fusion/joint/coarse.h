#pragma once

#include <span>
#include <utility>
#include <vector>

#include "gantry/fusion/range_surface.h"
#include "joint/normal_equations.h"
#include "joint/pyramid.h"

namespace gantry::internal {

/// One coarse image of every scan, and how its rays run; owned elsewhere.
struct CoarseScans {
  std::vector<const CoarseLevel*> levels;
  std::vector<const RayModel*> rays;
};

using Poses = std::vector<Pose>;                       ///< part_from_grid of every scan.
using Pairs = std::vector<std::pair<size_t, size_t>>;  ///< Unordered pairs, first < second.

/// Both ways of each pair, in the order in which all lists of sums have them: the second scan of pairs[k] on
/// the first at 2k, the first on the second at 2k + 1.
struct Slots {
  const Pairs& pairs;

  size_t count() const { return 2 * pairs.size(); }
  size_t target(size_t slot) const { return slot % 2 == 0 ? pairs[slot / 2].first : pairs[slot / 2].second; }
  size_t source(size_t slot) const { return slot % 2 == 0 ? pairs[slot / 2].second : pairs[slot / 2].first; }
};

struct WeighedPair {
  size_t a, b;
  size_t weight;  ///< How much they have in common; 0: nothing.
};
/// The pairs of greatest weight, about `most` for each scan, and those that connect what is apart.
Pairs strongest_pairs(std::vector<WeighedPair> candidates, size_t scans, size_t most);

/// Pairs that may share surface when all poses may be `reach_mm` wrong: all of them when there are few
/// scans, otherwise those that have most in common.
Pairs likely_pairs(const CoarseScans& scans, const Poses& part_from_grid, double reach_mm, size_t most);

/// Of all scans but the last, those that may have most in common with it, at most `most`.
std::vector<size_t> partners_of_last(const CoarseScans& scans, const Poses& part_from_grid, double reach_mm,
                                     size_t most);

/// What is believed of one pose beforehand: `information` of errors about the common centre.
struct PosePrior {
  Pose part_from_grid = Pose::Identity();
  Matrix6d information = Matrix6d::Zero();
};

struct CoarseOptions {
  double start_mm = 15;  ///< Robust scale at the beginning: how far apart matching surfaces may be.
  double end_mm = 2;     ///< ... and at the end.
  double shrink = 0.85;  ///< Of the scale, per iteration.
  double start_angle_rad = 1.0472, end_angle_rad = 0.6109;  ///< Normals of a match may differ by this.
  double point_share = 0.1;      ///< Weight of point-to-point beside point-to-plane.
  double violation_weight = 15;  ///< Of samples that lie where the target saw through.
  double border_weight = 3;      ///< Of matches at the border of the target's data: silhouettes hold well.
  size_t samples = 200;          ///< Of each scan.
  int extra_iterations = 3;      ///< At the final scale.
  std::vector<bool> fixed;       ///< Scans that do not move; empty: all may.
};

/// Brings all scans together at one level of the pyramid: in each round every sample of every scan takes
/// the nearest point of each of its partners whose normal agrees, in a window about where it projects to, and
/// one joint Gauss-Newton step is made; the robust (Geman-McClure) scale shrinks round by round, which
/// makes the start all but convex. Samples that lie in front of what the target saw, or on its empty
/// background, cannot be there and pull harder.
void align_coarse(const CoarseScans& scans, const Pairs& pairs, const std::vector<PosePrior>& priors,
                  const Eigen::Vector3d& centre, const CoarseOptions& options, Poses& part_from_grid);

}  // namespace gantry::internal
