#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "gantry/geometry/mesh_topology.h"
#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"
#include "gantry/geometry/signed_distance.h"
#include "gantry/inspection/alignment.h"
#include "gantry/inspection/datums.h"
#include "gantry/inspection/defect_class.h"
#include "gantry/inspection/surface_statistics.h"

namespace gantry {

/// By the rule of ISO 14253-1, with a guard band g on both sides of the tolerance T (docs/uncertainty.md):
///  - kFail: the peak of a region exceeds T + g;
///  - kPass: no region, of the least area that counts, comes nearer to T than g from within;
///  - kUndecided: neither of these; or what would be judged is not to be relied on.
enum class Verdict { kPass, kFail, kUndecided };
std::string_view to_string(Verdict verdict);  ///< "PASS", "FAIL", "UNDECIDED"

struct InspectionOptions {
  double tolerance_mm = 0;  ///< Deviations within +- this are good. Must be set, positive.
  /// Guard band on both sides of the tolerance, in standard uncertainties of each deviation: what lies beyond
  /// it is wrong with a probability of 5 % at most (ISO 14253-1). 0: the measured value decides.
  double guard_band = 1.645;
  bool align = true;  ///< Best fit to the CAD model first; otherwise the cloud is taken as it stands.
  AlignmentOptions alignment;
  std::optional<DatumSet> datums;  ///< After the best fit, lay the cloud onto the model by these alone.
  /// Motions that lay the CAD model onto itself to within this are looked for: the poses of the cloud that
  /// they lead to cannot be told apart. 0: not looked for.
  double symmetry_tolerance_mm = 0.05;
  double max_distance_mm = 10;  ///< Points further from the CAD surface than this do not belong to the part.
  /// A point is measured to faces whose normal is within this of its own (100 degrees): never to the
  /// other face of a thin wall, but past an edge.
  double max_angle_rad = 1.7453;
  double averaging_radius_mm = 0.5;  ///< Points are smoothed over this radius on the surface before they are
                                     ///< measured; at least twice the spacing of the points is used.
  double link_distance_mm = 3.0;  ///< Out-of-tolerance points closer than this belong to one defect (the two
                                  ///< faces of a thin wall do, so that a dent is one defect, not two).
  double min_defect_area_mm2 = 1.0;  ///< Smaller regions are not reported.
  double min_coverage = 0.5;         ///< Less of the CAD surface seen than this: UNDECIDED.
  /// Standard uncertainty of the sensor that neighbouring points of a scan have in common (its calibration,
  /// optics of the surface), so that smoothing does not reduce it: a quarter of the maximum permissible
  /// error of its data sheet, say. It is taken as independent from scan to scan.
  double systematic_sigma_mm = 0.02;
  /// The fixture that held the part, in the frame of the cloud: points nearer to it than to the part,
  /// or within `fixture_margin_mm` of it, are not judged.
  std::optional<TriangleMesh> fixture;
  /// The same, learned: a scan of the empty fixture, registered and merged, in the frame of the cloud. Points
  /// of it with few others around them are noise and left out.
  std::optional<PointCloud> fixture_scan;
  double fixture_margin_mm = 1.0;
  double min_unseen_area_mm2 = 10;  ///< Smaller pieces of CAD surface without data are not listed one by one.
};

/// What became of a point of the cloud.
enum class PointClass : unsigned char {
  kJudged,   ///< Has a deviation that counts.
  kFixture,  ///< Belongs to the fixture or lies too close to it to tell.
  kFar  ///< Clutter: no surface of the part within max_distance_mm, or too little smooth surface around it;
        ///< or beside the border of an open CAD model, where there is nothing to measure to.
};

/// A connected region out of tolerance. Positions in the frame of the CAD model.
struct Defect {
  int id = 0;                 ///< From 1, in order of falling |peak|.
  Eigen::Vector3d centre_mm;  ///< Centroid of the region.
  Eigen::Vector3d extent_mm;  ///< Size of its bounding box along x, y, z.
  double area_mm2 = 0;        ///< Of all faces that the region covers.
  double peak_mm = 0;  ///< Largest deviation, with its sign: a median over neighbours, so that no single
                       ///< point decides, looked for between the points as well.
  double mean_mm = 0;  ///< Mean magnitude: a dent deviates both ways, one on each face of the sheet.
  double uncertainty_mm = 0;   ///< Expanded uncertainty U (95 %) of the peak.
  Eigen::Vector3d peak_at_mm;  ///< Where the peak is.
  Eigen::Vector3d normal;      ///< Mean outward normal of the face on which the peak lies.
  size_t points = 0;
  /// |peak| exceeds the tolerance by more than the guard band; never of a registration residue.
  bool certain = false;
  DefectClass kind = DefectClass::kPartDefect;
  std::string words;             ///< What it looks like: "dent or bulge through the wall" ...
  std::string face, face_words;  ///< The CAD face that it lies on, or that is missing: see CadFace.
  /// Integrals of the deviation over the CAD surface, by sign; of a hole that was not made, what fills it.
  double extra_mm3 = 0, missing_mm3 = 0;
  double signed_mean_mm = 0;       ///< Mean deviation ...
  double mean_uncertainty_mm = 0;  ///< ... and its expanded uncertainty U (95 %); see SurfaceStatistics.
};

/// Statistics of the judged deviations (mm).
struct DeviationStatistics {
  size_t count = 0;
  double mean = 0, sigma = 0, rms = 0, min = 0, max = 0;
  double p05 = 0, p50 = 0, p95 = 0;  ///< Percentiles of the signed deviation.
  double within_tolerance = 0;       ///< Fraction of judged points.
};

/// What a deviation's uncertainty is made of, independent of each other: standard uncertainties (mm), or
/// variances (mm^2) where that is said.
struct UncertaintyBudget {
  double noise = 0;       ///< Of the sensor, pixel by pixel, after smoothing.
  double scan_poses = 0;  ///< Of the scans that measured it, as far as the alignment does not take it up.
  double alignment = 0;   ///< To the CAD model: noise, and what lies off the model by chance.
  double sensor = 0;      ///< What neighbouring points have in common.

  double combined() const {
    return std::sqrt(noise * noise + scan_poses * scan_poses + alignment * alignment + sensor * sensor);
  }
};

/// Standard uncertainties to each side that hold 95 % of a normal distribution.
constexpr double kCoverageFactor95 = 1.96;

struct InspectionResult {
  Verdict verdict = Verdict::kUndecided;
  std::string reason;               ///< One sentence for a person.
  AlignmentResult alignment;        ///< Its pose maps the given cloud into the CAD frame.
  PointCloud cloud;                 ///< The given cloud in the CAD frame, same order.
  std::vector<float> deviation_mm;  ///< Per point, smoothed; NaN unless judged. Positive: too much material.
  /// Per point, standard uncertainty; NaN unless judged. With a probability of 95 % the true deviation lies
  /// within 1.96 times that of the measured one.
  std::vector<float> uncertainty_mm;
  UncertaintyBudget budget;    ///< Of a typical point: medians over the judged ones.
  bool poses_known = false;    ///< Whether the cloud said which scans it comes from, and how well these lie.
  std::string doubt;  ///< Why the cloud itself is not to be relied on (CloudSources::doubt); empty: it is.
  std::vector<int> defect_id;  ///< Per point: 0 none, else Defect::id.
  std::vector<PointClass> point_class;  ///< Per point.
  DeviationStatistics statistics;
  double coverage = 0;  ///< Fraction of the CAD surface that was seen.
  std::vector<Defect> defects;
  /// Regions in tolerance as measured, but not for certain: their peaks lie within it by less than the guard
  /// band. In order of falling |peak|, their ids from 1; they are not marked in `defect_id`.
  std::vector<Defect> doubtful;
  /// Connected pieces of CAD surface that no judged point covers, of at least `min_unseen_area_mm2`, the
  /// largest first; with the smaller ones they add up to `unseen_mm2`.
  std::vector<UnjudgedRegion> unseen;
  double unseen_mm2 = 0;
  std::vector<UnjudgedRegion> fixture_regions;  ///< What was found of the fixture, the largest first.
  std::vector<SurfaceStatistics> faces;         ///< Of each smooth face of the CAD model (cad_faces.h).
  std::vector<SurfaceStatistics> regions;       ///< Of tiles of about equal size, about 70 of them.
  MeshTopology topology;                        ///< Of the CAD model's mesh.
  size_t beside_border = 0;  ///< Points whose closest CAD surface is the border of its open mesh: not judged.
};

/// Compares a cloud with the CAD model. A cloud without normals is measured to the closest surface of
/// any orientation. Throws InputError for options out of range or a cloud without points.
InspectionResult inspect(const PointCloud& cloud, const SignedDistance& reference,
                         const InspectionOptions& options);

}  // namespace gantry
