#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "gantry/fusion/global_icp.h"
#include "gantry/fusion/joint.h"
#include "gantry/fusion/merge.h"
#include "gantry/fusion/overlap_residual.h"
#include "gantry/fusion/pairwise.h"
#include "gantry/fusion/pose_graph_registration.h"
#include "gantry/fusion/preprocess.h"
#include "gantry/fusion/registration.h"

namespace gantry {

/// "joint", "refined-pose-graph", "pose-graph" or "global-icp".
std::string_view to_string(RegistrationMethod method);
/// The method of that name. Throws InputError naming the choices.
RegistrationMethod registration_method(std::string_view name);

/// Nothing has to be set. Options of other methods than the chosen one are not looked at.
struct FusionOptions {
  RegistrationMethod method = RegistrationMethod::kJoint;
  PreprocessOptions preprocess;
  JointOptions joint;
  PoseGraphRegistrationOptions pose_graph;  ///< Of both refined-pose-graph and pose-graph.
  /// How refined-pose-graph registers pairs; pose-graph always goes point-to-plane.
  PairwiseMethod refined_pairwise = PairwiseMethod::kGeneralizedIcp;
  GlobalIcpOptions global_icp;
  MergeOptions merge;
  bool merge_scans = true;  ///< False: poses only, FusionResult::merged stays empty.
};

/// What became of one scan.
struct ScanResult {
  std::string name;
  UncertainPose part_from_sensor;  ///< Covariance relative to the first scan.
  double moved_mm = 0;             ///< How far registration moved the scan's centre from where it was tagged,
  double turned_rad = 0;           ///< and by how much it turned the scan.
  double rms_mm = 0;               ///< Overlap residual with all other scans at the final poses.
  double noise_mm = 0;             ///< Of the sensor, along the normal.
  double spacing_mm = 0;           ///< Median distance of neighbouring points.
  size_t measured = 0;             ///< Points of the scan, of which ...
  size_t points = 0;               ///< ... this many are left after preprocessing,
  size_t dropped_crop = 0;         ///< were outside the part's volume,
  size_t dropped_edges = 0;        ///< at depth steps, outliers or grazing,
  size_t dropped_hidden = 0;       ///< or hidden behind others (scans without grid).
  bool connected = true;  ///< False: no pair leads to it from the first scan; only its tag places it.
  std::string left_out;   ///< Why it takes no part (ScanReport::left_out); empty: it does.
};

struct FusionResult {
  RegistrationMethod method = RegistrationMethod::kJoint;
  std::vector<ScanResult> scans;
  Registration registration;      ///< Pairs, parameters, and what the method says of its own result.
  PointCloud merged;              ///< Part frame, mm, with normals and sigma; without what is left out.
  MergeReport merge;              ///< What became of the measurements in it.
  OverlapResidual before, after;  ///< At the tagged and at the final poses, of all scans.
  size_t sides_guessed = 0;    ///< Scans turned over because their data did not tell where the sensor stood.
  bool trusted = true;         ///< False: the result may be wrong, and `reason` says what speaks against it.
  std::string reason, advice;  ///< Why not trusted, and what to do about it.
  std::vector<std::pair<std::string, double>> timings_s;
};

/// Multi-view registration: scans in as they arrive, one merged cloud out. The first scan's pose is kept.
///
///   Fusion fusion(options);
///   for (auto& scan : scans) fusion.add(scan);     // while the stages move on
///   FusionResult result = fusion.finish();
///
/// add() does the part of the work that grows with the number of pixels, and keeps the range surface only,
/// so the scan can be freed. finish() registers all scans at once by the chosen method: however they
/// arrived, the answer is that of all of them given together, bit for bit.
class Fusion {
 public:
  /// Throws InputError naming an option of preprocessing that is out of range.
  explicit Fusion(FusionOptions options);
  ~Fusion();

  /// Throws InputError when the scan has too few usable points, or repeats an earlier one (which would count
  /// its errors as agreement); the fusion goes on without it.
  void add(const TaggedScan& scan);
  size_t size() const;
  /// Ends this fusion. Throws InputError when no scan was added or an option of the method is out of range.
  FusionResult finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
