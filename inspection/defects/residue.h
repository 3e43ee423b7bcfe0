#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "gantry/geometry/point_index.h"
#include "gantry/geometry/pose.h"

namespace gantry::internal {

/// No single scan measured the point.
constexpr uint16_t kManyScans = 0xffff;

/// Deviations of judged points, each with the scan that it was measured by. All spans are equally long.
struct ScanDeviations {
  std::span<const Eigen::Vector3f> point;   ///< On the CAD surface.
  std::span<const Eigen::Vector3f> normal;  ///< Of the CAD surface there.
  std::span<const float> deviation_mm;      ///< NaN: not judged.
  std::span<const uint16_t> scan;           ///< Or kManyScans.
};

/// Regions that a scan which lies a little wrong brings about, told from what the part is like. Where scans
/// overlap, a deviation of the part shows in all of them alike, while a scan that was moved by a twist t
/// departs from the others by (p x n, n) t. So for each scan a twist is fitted, robustly, to how far its
/// points depart from the mean of the other scans' points within a millimetre on the same side, over its
/// whole overlap.
class ResidueFinder {
 public:
  struct Motion {
    size_t pairs = 0;  ///< Points beside which other scans measured; with fewer than 30 the twist is zero.
    /// Rotation (rad) about the middle of all points, translation (mm); CAD frame. Zero along what is not
    /// held.
    Vector6d twist = Vector6d::Zero();
  };

  /// What the spans show must outlive this.
  ResidueFinder(const ScanDeviations& deviations, double tolerance_mm);
  ~ResidueFinder();

  /// The scan whose motion explains the region, if one does:
  ///  1. it measured most of the region's points by itself;
  ///  2. other scans measured the surface beside a third of these at least, and found four fifths of it good;
  ///  3. when its motion is taken back, four fifths of these are in tolerance as well.
  std::optional<size_t> scan_that_explains(std::span<const size_t> members) const;

  const std::vector<Motion>& motions() const { return motions_; }  ///< Of each scan.

 private:
  void fit_motion(size_t scan, const std::vector<size_t>& points);
  /// Mean deviation of other scans' points close to a point; NaN: there are none.
  double beside(size_t i) const;
  double moved_by(size_t scan, size_t i) const;

  ScanDeviations all_;
  double tolerance_mm_;
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
  std::vector<size_t> judged_;  ///< Of one scan each.
  std::vector<Eigen::Vector3f> points_;
  std::unique_ptr<PointIndex> index_;
  std::vector<Motion> motions_;
};

}  // namespace gantry::internal
