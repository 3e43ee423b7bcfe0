#pragma once

#include <span>

#include "scan_set.h"

namespace gantry::bench {

/// How far the poses found are from the truth. Only relative poses can be right or wrong, so the first
/// scan's pose is made the true one first (the gauge).
struct PoseError {
  /// The paper's figure (Table 1): of each scan but the first, the mean of the absolute values of all 16
  /// elements of (estimated - true) correction matrix, correction = part_from_sensor * initial^-1; mean over
  /// the scans. It mixes units and depends on the origin: for the comparison only.
  double mae16 = 0;
  /// The furthest that any measured point of any scan lies from where it belongs, mm: what to judge by.
  double dmax_mm = 0;

  static constexpr double kSuccessMm = 1;
  bool success() const { return dmax_mm < kSuccessMm; }
};

PoseError pose_error(const ScanSet& set, std::span<const UncertainPose> initial, std::span<const Pose> found);

}  // namespace gantry::bench
