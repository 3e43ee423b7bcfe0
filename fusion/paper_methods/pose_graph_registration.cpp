#include "gantry/fusion/pose_graph_registration.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <numbers>
#include <string>

#include "gantry/foundation/error.h"
#include "gantry/fusion/pairwise.h"
#include "gantry/fusion/pose_graph.h"
#include "gantry/fusion/sampling.h"
#include "gantry/fusion/voxel_grid.h"
#include "paper_methods/registration_support.h"

namespace gantry {
namespace {

constexpr size_t kMinInliers = 100;
/// Averages matched in each pair of the first round: enough to find the way.
constexpr size_t kVoxelSamples = 3000;
/// Measured points that lead each pair of the second round to where the last pass begins.
constexpr size_t kPointSamples = 6000;
/// Cells of the overlap grid once the poses are known to the voxel.
constexpr double kCellInVoxels = 3;

void validate(const PoseGraphRegistrationOptions& options) {
  if (!(options.min_overlap >= 0 && options.min_overlap <= 1))
    throw InputError("min_overlap: must be in [0, 1], found " + std::to_string(options.min_overlap));
  if (options.samples < kMinInliers)
    throw InputError("samples: must be at least " + std::to_string(kMinInliers) + ", found " +
                     std::to_string(options.samples));
  if (!(options.max_angle_rad > 0 && options.max_angle_rad <= std::numbers::pi))
    throw InputError("max_angle_rad: must be in (0, pi], found " + std::to_string(options.max_angle_rad));
}

/// Surfaces of one resolution with what matching needs of each.
struct Level {
  std::span<const ScanSurface> surfaces;
  std::deque<MatchTarget> targets;
  std::vector<std::vector<uint32_t>> samples;

  Level(std::span<const ScanSurface> of, size_t sample_count) : surfaces(of), samples(of.size()) {
    std::vector<std::unique_ptr<MatchTarget>> built(of.size());
    tbb::parallel_for(size_t{0}, of.size(), [&](size_t i) {
      built[i] = std::make_unique<MatchTarget>(of[i]);
      samples[i] = sample_points(of[i], SamplingStrategy::kNormalSpace, sample_count);
    });
    for (auto& target : built) targets.push_back(std::move(*target));
  }
};

std::vector<PoseGraphEdge> register_edges(const Level& level, const std::vector<OverlappingPair>& pairs,
                                          const std::vector<Pose>& poses, const PairwiseOptions& options,
                                          const std::vector<double>& start_mm) {
  std::vector<PoseGraphEdge> edges(pairs.size());
  tbb::parallel_for(size_t{0}, pairs.size(), [&](size_t k) {
    PoseGraphEdge& edge = edges[k];
    edge.target = pairs[k].target;
    edge.source = pairs[k].source;
    edge.odometry = pairs[k].neighbours;
    edge.predicted_overlap = pairs[k].overlap;
    PairwiseOptions pairwise = options;
    pairwise.max_distance_mm = std::max(start_mm[k], pairwise.min_distance_mm);
    edge.match =
        register_pair(level.targets[edge.target], level.surfaces[edge.source], level.samples[edge.source],
                      poses[edge.target].inverse() * poses[edge.source], pairwise);
    if (edge.match.inliers < kMinInliers) {
      edge.kept = false;
      edge.reason = "only " + std::to_string(edge.match.inliers) + " matching points";
    } else if (!edge.match.converged) {
      edge.kept = false;
      edge.reason = "pairwise registration did not converge";
    }
  });
  return edges;
}

PairReport report(const PoseGraphEdge& edge) {
  PairReport pair;
  pair.target = edge.target;
  pair.source = edge.source;
  pair.odometry = edge.odometry;
  pair.predicted_overlap = edge.predicted_overlap;
  pair.overlap = edge.match.overlap;
  pair.inliers = edge.match.inliers;
  pair.rms_mm = edge.match.rms_mm;
  pair.disagreement_mm = edge.disagreement_mm;
  pair.kept = edge.kept;
  pair.reason = edge.reason;
  return pair;
}

std::vector<Pose> means(const std::vector<UncertainPose>& poses) {
  std::vector<Pose> out;
  for (const auto& pose : poses) out.push_back(pose.mean);
  return out;
}

Registration register_with(PairwiseMethod method, std::span<const ScanSurface> surfaces,
                           const PoseGraphRegistrationOptions& options) {
  validate(options);
  const ResolvedParameters parameters = resolve(options.parameters, surfaces);
  std::vector<UncertainPose> tagged;
  std::vector<Eigen::Vector3d> centres;
  for (const ScanSurface& surface : surfaces) {
    tagged.push_back(surface.part_from_sensor);
    centres.push_back(centroid(surface));
  }

  std::vector<ScanSurface> averages(surfaces.size());
  tbb::parallel_for(size_t{0}, surfaces.size(), [&](size_t i) {
    averages[i] =
        parameters.downsample ? voxel_downsample(surfaces[i], parameters.voxel_size_mm) : surfaces[i];
  });
  PairwiseOptions pairwise;
  pairwise.method = method;
  pairwise.max_angle_rad = options.max_angle_rad;
  pairwise.min_distance_mm = parameters.max_distance_threshold_mm;
  const PoseGraphOptions graph{parameters.edge_prune_threshold_mm};

  const std::vector<OverlappingPair> pairs = pairs_at_tags(surfaces, options.min_overlap);
  std::vector<double> start_mm;
  for (const OverlappingPair& pair : pairs)
    start_mm.push_back(parameters.fixed_distance
                           ? parameters.max_distance_threshold_mm
                           : start_radius_mm(surfaces[pair.target], surfaces[pair.source]));
  std::vector<PoseGraphEdge> edges = register_edges(
      Level(averages, options.measured_points ? kVoxelSamples : 0), pairs, means(tagged), pairwise, start_mm);
  PoseGraphResult adjusted = optimise_pose_graph(tagged, edges, centres, graph);

  if (options.measured_points) {
    const std::vector<Pose> poses = means(adjusted.part_from_sensor);
    const std::vector<OverlappingPair> closer =
        overlapping_pairs(surfaces, poses, kCellInVoxels * parameters.voxel_size_mm, options.min_overlap);
    pairwise.min_distance_mm = 0;
    pairwise.final_samples = options.samples;
    edges = register_edges(Level(surfaces, kPointSamples), closer, poses, pairwise,
                           std::vector<double>(closer.size(), parameters.voxel_size_mm));
    adjusted = optimise_pose_graph(tagged, edges, centres, graph);
  }

  Registration result;
  result.parameters = parameters.choices;
  result.part_from_sensor = adjusted.part_from_sensor;
  for (const PoseGraphEdge& edge : edges) {
    result.pairs.push_back(report(edge));
    result.iterations = std::max(result.iterations, edge.match.iterations);
  }
  result.reason = unconnected_scans(surfaces, result.pairs);
  if (result.reason.empty() && !adjusted.converged) result.reason = "the pose graph did not converge";
  result.converged = result.reason.empty();
  return result;
}

}  // namespace

Registration register_pose_graph(std::span<const ScanSurface> surfaces,
                                 const PoseGraphRegistrationOptions& options) {
  return register_with(PairwiseMethod::kPointToPlane, surfaces, options);
}

Registration register_refined_pose_graph(std::span<const ScanSurface> surfaces,
                                         const PoseGraphRegistrationOptions& options) {
  return register_with(PairwiseMethod::kGeneralizedIcp, surfaces, options);
}

}  // namespace gantry
