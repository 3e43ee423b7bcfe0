#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gantry/fusion/gicp.h"
#include "gantry/fusion/merge.h"
#include "gantry/fusion/pose_graph.h"
#include "gantry/fusion/preprocess.h"

namespace gantry {

struct FusionOptions {
  PreprocessOptions preprocess;
  GicpOptions gicp;  ///< max_distance_mm is derived from the poses' covariance for each pair.
  PoseGraphOptions pose_graph;
  MergeOptions merge;
  double min_overlap = 0.1;  ///< Pairs that are predicted to share less are not registered.
};

/// What became of one scan.
struct ScanResult {
  std::string name;
  UncertainPose part_from_sensor;  ///< Covariance relative to the first scan.
  double moved_mm = 0;             ///< How far registration moved the scan's centre from where it was tagged.
  double rms_mm = 0;               ///< Of its matches with all kept neighbours, at the final poses.
  size_t points = 0;               ///< After preprocessing.
  size_t measured = 0;
  double noise_mm = 0;
  bool connected = true;  ///< False: no kept edge reaches it from the first scan; only its tag places it.
};

/// Agreement of all pairs that share surface, at given poses: matches both ways, along the normal,
/// within 2 mm and 45 degrees, the worst tenth dropped.
struct OverlapResidual {
  double rms_mm = 0;
  size_t matches = 0;
};

struct FusionResult {
  std::vector<ScanResult> scans;
  std::vector<PoseGraphEdge> edges;
  PointCloud merged;  ///< Part frame, mm, with normals and sigma.
  double voxel_mm = 0;
  OverlapResidual before, after;  ///< At the tagged and at the final poses.
  bool normals_flipped = false;   ///< The scans did not tell where the sensor was; the closed shape decided.
  bool trusted = true;            ///< All scans connected and the graph converged.
  std::string reason;             ///< Why not trusted.
  std::vector<std::pair<std::string, double>> timings_s;
};

/// Multi-view registration, method "refined pose graph" (the paper, section of that name): each scan is
/// preprocessed and matched by GICP to the earlier ones it overlaps as it arrives; finish() adjusts the
/// pose graph and merges. The first scan's pose is kept.
///
///   Fusion fusion(options);
///   for (auto& scan : scans) fusion.add(scan);     // while the stages move on
///   FusionResult result = fusion.finish();
class Fusion {
 public:
  explicit Fusion(FusionOptions options);
  ~Fusion();

  /// Throws InputError when the scan has too few usable points; the fusion goes on without it.
  void add(const TaggedScan& scan);
  size_t size() const;
  /// Throws InputError when no scan was added.
  FusionResult finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
