#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace gantry {

/// Where the points of a merged cloud come from: which scans measured each, and how well these scans are
/// placed. With it the errors of the scans' poses can be carried to every point: point p, of which scan k
/// holds the share s_k, is off by the sum over k of s_k * (e_k.rotation x p + e_k.translation).
struct CloudSources {
  /// What one scan contributed to one point.
  struct Share {
    uint16_t scan = 0;   ///< Index into `scans`.
    uint16_t parts = 0;  ///< Of kWhole. Those of a point sum up to that, but for rounding.
    static constexpr int kWhole = 65535;
    double fraction() const { return static_cast<double>(parts) / kWhole; }
  };

  std::vector<std::string> scans;  ///< Names, in the order of the covariance.
  std::vector<uint32_t> first;     ///< Shares of point i: from first[i] to first[i + 1]; points + 1 numbers.
  std::vector<Share> shares;
  /// Of the errors of all scans' poses, 6 rows each: rotation (rad) about the origin of the cloud's frame,
  /// then translation (mm), as UncertainPose has them. Errors that all scans have in common are in it.
  Eigen::MatrixXd pose_covariance;
  std::string doubt;  ///< Why the scans' places are not to be relied on, in one line; empty: they are.

  size_t points() const { return first.empty() ? 0 : first.size() - 1; }
  std::span<const Share> of(size_t point) const {
    return {shares.data() + first[point], shares.data() + first[point + 1]};
  }
};

}  // namespace gantry
