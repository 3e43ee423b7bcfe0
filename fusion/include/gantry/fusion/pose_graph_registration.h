#pragma once

#include <span>

#include "gantry/fusion/paper_parameters.h"
#include "gantry/fusion/preprocess.h"
#include "gantry/fusion/registration.h"

namespace gantry {

struct PoseGraphRegistrationOptions {
  PaperParameters parameters;
  /// After the paper's steps on the downsampled scans, match every pair once more on the measured points from
  /// where the graph put them, and adjust the graph to that. False: the paper's method and no more, of which
  /// the accuracy is that of voxel averages.
  bool measured_points = true;
  double min_overlap = 0.1;       ///< Pairs predicted to share less (fraction) are not registered.
  double max_angle_rad = 0.6109;  ///< See PairwiseOptions; pi for the paper's baseline, blind to sides.
  size_t samples = 60000;  ///< Measured points of each pair's last pass; the accuracy grows with its root.
};

/// The paper's "Pose Graph", its baseline (Choi et al. 2015): point-to-plane registration of pairs, edges
/// between neighbours (odometry) and loop closures, pruning, robust adjustment of the whole graph.
///
/// Steps: voxel_downsample; pairs by predicted overlap at the tagged poses; register_pair on the averages;
/// optimise_pose_graph; then, with `measured_points`, pairs by overlap at the poses found, register_pair on
/// the points as measured, optimise_pose_graph. Edges are weighted by what their points constrain
/// (PairwiseResult::information), so that a weak loop closure cannot bend a strong chain.
///
/// The tagged covariances say how far off the tags may be; the first scan's pose is kept. The same input
/// gives the same poses for any number of threads. Throws InputError for options out of range.
Registration register_pose_graph(std::span<const ScanSurface> surfaces,
                                 const PoseGraphRegistrationOptions& options);

/// The paper's "Refined Pose Graph": the same with Generalized ICP for the pairs.
Registration register_refined_pose_graph(std::span<const ScanSurface> surfaces,
                                         const PoseGraphRegistrationOptions& options);

}  // namespace gantry
