#pragma once

#include <optional>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/point_index.h"
#include "gantry/geometry/pose.h"
#include "global_initialisation/free_space.h"

namespace gantry {

/// A guessed pose after a few steps of alignment, with what the surfaces say of it.
struct CheckedHypothesis {
  Pose target_from_source = Pose::Identity();
  size_t inliers = 0;  ///< Of all source points.
  double score = 0;    ///< Agreement of the surfaces where they meet, less the points in free space.
};

/// How a guess is aligned before it is judged.
struct AlignmentSteps {
  double gate_spacings;  ///< How far apart, in point spacings, points may be matched.
  double point_share;  ///< Weight of point-to-point beside point-to-plane: keeps flat overlaps from drifting.
  int iterations;
};
inline constexpr AlignmentSteps kCoarseAlignment{4.5, 0.1, 5};
inline constexpr AlignmentSteps kFineAlignment{1.5, 0.01, 15};

/// Two decimated surfaces against which guessed poses are improved and judged. Thread-safe.
class HypothesisCheck {
 public:
  /// With `free_space`, each cloud's sensor lies at the origin of its frame.
  HypothesisCheck(const PointCloud& target, const PointCloud& source, const PointIndex& target_index,
                  double spacing_mm, bool free_space);

  /// Aligns and counts. Nothing when too little of the source touches the target, or when the touching
  /// surface leaves more than two directions free, as a plane or a sphere does: such a pose is anybody's
  /// guess.
  std::optional<CheckedHypothesis> check(const Pose& target_from_source, const AlignmentSteps& steps) const;

  const Eigen::Vector3d& source_centre() const { return source_centre_; }

 private:
  struct Fit {
    Matrix6d planes = Matrix6d::Zero();  ///< Sum of squared point-to-plane Jacobians, mm and lever arms of 1.
    Vector6d motion = Vector6d::Zero();
    size_t count = 0;
    size_t touching = 0;   ///< Of these, within the noise of the target's plane.
    double agreement = 0;  ///< Sum over the matches of 1 (on the plane) to -0.5 (off it).
  };
  Fit fit(const Pose& pose, const Eigen::Vector3d& centre, double gate_mm, double point_share,
          size_t stride) const;
  double free_space_violation(const Pose& pose) const;

  const PointCloud& target_;
  const PointCloud& source_;
  const PointIndex& target_index_;
  double spacing_mm_;
  Eigen::Vector3d source_centre_;
  double radius_mm_;
  std::optional<FreeSpace> seen_by_target_, seen_by_source_;
};

}  // namespace gantry
