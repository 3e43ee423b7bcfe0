#pragma once

#include <string>
#include <vector>

#include "gantry/fusion/pairwise.h"
#include "gantry/geometry/pose.h"

namespace gantry {

/// A measured relative pose between two scans.
struct PoseGraphEdge {
  size_t target = 0, source = 0;  ///< Indices of scans, target < source.
  bool odometry = false;          ///< Neighbours; otherwise a loop closure.
  double predicted_overlap = 0;
  PairwiseResult match;
  bool kept = true;
  std::string reason;  ///< Why it was pruned, or how far it disagrees with the final poses.
  /// Between the measured and the final relative pose, at the scan's centre, as far as the edge's own data
  /// can tell: along directions that it leaves free it cannot disagree.
  double disagreement_mm = 0;
};

struct PoseGraphOptions {
  /// Edges that disagree with the final poses by more than this are pruned and the rest solved again
  /// (the paper's edge prune threshold, given a unit: mm at the centre of the source scan).
  double edge_prune_threshold_mm = 0.5;
};

struct PoseGraphResult {
  std::vector<UncertainPose> part_from_sensor;
  bool converged = false;
  int pruned = 0;
};

/// The displacement of `centre` (source frame, mm) between an edge's measured and an actual relative pose,
/// without the part along which the edge's information is weaker than `resolution_mm` (one sigma).
double edge_disagreement_mm(const PairwiseResult& match, const Pose& actual_target_from_source,
                            const Eigen::Vector3d& centre, double resolution_mm);

/// Adjusts all poses so that they agree with the edges (each weighted by its information), and with
/// the tagged poses (weighted by their covariance). The first scan's pose is the gauge and stays as
/// tagged; covariances are relative to it. `centres` are the scans' centroids in their sensor frames.
/// Solved by Ceres with a Cauchy loss on the edges; the edge that disagrees most is pruned and the rest
/// solved again until all agree. Edges that come in with kept = false, or without information, take no
/// part. Throws InputError when the sizes do not match or the threshold is not positive.
PoseGraphResult optimise_pose_graph(const std::vector<UncertainPose>& tagged,
                                    std::vector<PoseGraphEdge>& edges,
                                    const std::vector<Eigen::Vector3d>& centres,
                                    const PoseGraphOptions& options);

}  // namespace gantry
