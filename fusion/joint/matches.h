#pragma once

#include <vector>

#include "gantry/fusion/range_surface.h"
#include "joint/normal_equations.h"

namespace gantry::internal {

/// What is known of the part's edges: of one seen by two scans, and of one at which a surface that one scan
/// sees ends at a face that another one sees.
struct EdgeModel {
  /// Pixels of an edge differ by sigma_mm, edges of two scans by offset_mm, and beside that all of them by
  /// pair_offset_mm: edges are broken more or less, and look different from different sides. Sigma of 0: all
  /// as the matches show, which overstates them before the scans are in place.
  struct Scatter {
    double sigma_mm = 0, offset_mm = 0, pair_offset_mm = 0;
  };
  Scatter at_edges, at_faces;
  double break_mm = 0;  ///< How far before the face the surface ends: edges are chamfered or rounded.
};

struct MatchGates {
  double scale_mm = 1;  ///< Of the Geman-McClure loss.
  double reach_mm = 3;  ///< Residuals beyond are no matches.
  double max_angle_rad = 0.5236;
  int stride = 4;  ///< Every stride-th row and column of the source takes part.
  /// Variance (rad^2) by which noise tilts the normals of matches, about each axis across them; see
  /// PairSum::tilts.
  double normal_variance = 0;
  EdgeModel edges;
};

/// What a small block of the source contributed, part frame: pixels so near to each other may share errors,
/// so the covariance treats them as one observation.
struct BlockSum {
  Eigen::Vector3f place;  ///< Mean of its matches.
  Eigen::Matrix<float, 6, 1> gradient;
  Eigen::Matrix<float, 6, 6> hessian;
};

/// Which blocks of 16 x 16 pixels of a source have matches in a target, row by row of blocks: once poses
/// hardly move any more, the others need not be visited again.
struct ActiveBlocks {
  static constexpr int kPixels = 16;
  std::vector<unsigned char> active;  ///< Empty: all blocks are visited.
  static int across(int width) { return (width + kPixels - 1) / kPixels; }
};

/// Matches rows [first_row, last_row) of one scan against the surface of another by projection.
/// `target_from_source` between grid frames; the sums are in the part frame about `centre`. The residual
/// lies along the mean of both normals. `blocks` (optional) takes the sums block by block. Of `visited`
/// (optional) the inactive blocks are skipped; `found` (optional, sized by the caller) is told which blocks
/// had matches. Both need a stride of at most 4 and a first row that begins a block.
PairSum match_by_projection(const RangeSurface& target, const RangeSurface& source,
                            const Pose& target_from_source, const Pose& part_from_target,
                            const Eigen::Vector3d& centre, const MatchGates& gates, int first_row,
                            int last_row, std::vector<BlockSum>* blocks = nullptr,
                            const ActiveBlocks* visited = nullptr, ActiveBlocks* found = nullptr);

/// How two scans agree: what became of the source's pixels that fall where the target has measured.
struct Agreement {
  size_t tested = 0;      ///< Fell on the target's data or on its empty background.
  size_t matched = 0;     ///< On the surface, facing the same way.
  size_t in_front = 0;    ///< In front of what the target saw: it would have been seen instead.
  size_t background = 0;  ///< Where the target saw nothing at all. May also be dark, or in shadow.
  size_t contact = 0;     ///< On the surface, facing the other way: a wall without thickness.
  double squares = 0;     ///< Of the matches' distances.

  Agreement& operator+=(const Agreement& o);
};

/// Counts agreement of every stride-th pixel; `tolerance_mm` along the normal.
Agreement compare(const RangeSurface& target, const RangeSurface& source, const Pose& target_from_source,
                  double tolerance_mm, int stride);

}  // namespace gantry::internal
