#pragma once

#include <string>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"
#include "gantry/geometry/signed_distance.h"

namespace gantry {

struct AlignmentOptions {
  double initial_distance_mm = 5.0;  ///< Points further from the model than this are left out at first.
  size_t samples = 20000;            ///< Points used, spread evenly over the cloud.
  int max_iterations = 60;           ///< Of the first fit, and of each one after the mask changed.
  double max_angle_rad =
      0.7854;  ///< A point pairs with faces whose normal is within this of its own (45 degrees).
  int max_mask_rounds = 15;  ///< Fit and mask by turns at most so often.
  /// The start may be anywhere, turned by any angle: the pose is searched for first (global_search.h).
  bool from_any_start = false;
};

/// A motion of the cloud against the model that the points do not hold.
struct FreeMotion {
  /// A twist in the CAD frame (rotation vector, translation of the origin), scaled so that points of the
  /// part move by 1 mm (root mean square).
  Vector6d twist = Vector6d::Zero();
  std::string words;  ///< "turning about the axis along z through (0.0, 0.0, 55.0)", "sliding along x"
};

/// A motion that lays the CAD model onto itself: `motion * cad_from_cloud` fits as well as cad_from_cloud.
struct EquivalentPose {
  Pose motion = Pose::Identity();  ///< In the CAD frame.
  std::string words;               ///< "turned by 180 degrees about z"
};

/// How one datum was met (alignment to datums, datums.h).
struct DatumFit {
  std::string name;
  std::string words;     ///< "plane, fixes 3 freedoms"
  int fixes = 0;         ///< Freedoms that were open when its turn came, and that it fixed.
  size_t points = 0;     ///< Of the cloud.
  double rms_mm = 0;     ///< Of these points about the fitted feature: its form error and noise.
  double offset_mm = 0;  ///< What is left between the fitted feature and the CAD's, at the datum's place ...
  double tilt_deg = 0;   ///< ... and in direction: what earlier datums did not leave to this one.
};

/// A cloud laid onto a CAD model.
struct AlignmentResult {
  Pose cad_from_cloud = Pose::Identity();
  /// Of cad_from_cloud, errors in the CAD frame (see UncertainPose). Along a free motion the standard
  /// deviation is the size of the part: nothing is known there.
  Matrix6d covariance = Matrix6d::Zero();
  /// The same without the free motions: what the deviations of points are uncertain by, since a free motion
  /// slides surfaces along themselves.
  Matrix6d held_covariance = Matrix6d::Zero();
  /// How the alignment follows errors of the scans' poses, when the cloud has sources: minus the sum over
  /// scans of matrix times the scan's error (a twist in the CAD frame) is the motion that they cause. Empty:
  /// not known, or nothing was aligned.
  std::vector<Matrix6d> scan_influence;
  double rms_before_mm = 0;              ///< Over the samples within the initial distance.
  double rms_after_mm = 0;               ///< Over the inliers.
  double inlier_fraction = 0;            ///< Of the samples: those that hold the result.
  double masked_fraction = 0;            ///< Of the samples: those in regions that are no noise.
  int masked_regions = 0;                ///< Connected regions left out, each with a margin.
  int iterations = 0;                    ///< Of all fits together.
  int mask_rounds = 0;                   ///< How often fit and mask took turns.
  bool converged = false;                ///< Pose and mask came to rest.
  std::string status;                    ///< In words for a person: why it did not converge; empty otherwise.
  std::vector<FreeMotion> free_motions;  ///< Empty: all six freedoms are held.
  std::vector<EquivalentPose> equivalents;  ///< Other than the one given: see find_symmetries().
  std::vector<DatumFit> datums;             ///< Empty for a best fit.

  /// "4 equivalent poses: turned by 180 degrees about z, ...", or "" without symmetry.
  std::string symmetry_text() const;
  /// "free: turning about ...", or "" when all is held.
  std::string free_text() const;
};

/// Robust best fit that real defects do not pull. The start is the cloud's own frame, within a few mm and
/// degrees of the model, or anywhere (`from_any_start`).
///
///  1. Point-to-plane fit with Tukey's biweight, its scale from the residuals' MAD.
///  2. Where residuals, averaged over neighbours, lie out by more than noise does, the connected region is a
///     defect: it is masked with a margin and the fit repeated, until the mask is at rest. Points weigh
///     1 / sigma^2 when the cloud has sigma.
///  3. Directions that only the facets of the mesh hold (a cylinder about its axis), or nothing at all, are
///     free: the start is kept along them and they are named.
///  4. Covariance: neighbouring residuals are correlated, so surface patches, not points, count as
///     independent: a sandwich over patches (Cameron and Miller, "A practitioner's guide to cluster-robust
///     inference", 2015, "CR2"), shrunk towards the homogeneous case as far as its own scatter asks for
///     (Ledoit and Wolf, "A well-conditioned estimator for large-dimensional covariance matrices", 2004).
///
/// Throws InputError for options out of range. Too few points near the model, or no pose found: not
/// converged, `status` says why.
AlignmentResult align_to_model(const PointCloud& cloud, const SignedDistance& model,
                               const AlignmentOptions& options);

/// Motions that lay the model onto itself to within `tolerance_mm`, the identity and what a free motion of
/// the whole surface does (a turned part about its axis) left out.
std::vector<EquivalentPose> find_symmetries(const SignedDistance& model, double tolerance_mm);

}  // namespace gantry
