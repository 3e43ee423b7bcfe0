#pragma once

#include <array>
#include <vector>

#include "gantry/fusion/range_surface.h"
#include "joint/matches.h"
#include "joint/normal_equations.h"

namespace gantry::internal {

/// The edges of a scan's surface, by the tiles of its image in which they lie.
class EdgeIndex {
 public:
  static constexpr int kTile_px = 16;

  EdgeIndex() = default;
  explicit EdgeIndex(const RangeSurface& surface);

  /// Calls visit(edge) for all edges in tiles within `radius_px` of a pixel.
  template <typename Visit>
  void near(const Eigen::Vector2d& pixel, double radius_px, Visit&& visit) const {
    const auto tile = [](double x, int most) {
      return static_cast<int>(std::clamp(std::floor(x / kTile_px), -1.0, static_cast<double>(most)));
    };
    const int left = std::max(0, tile(pixel.x() - radius_px, across_)),
              right = std::min(across_ - 1, tile(pixel.x() + radius_px, across_)),
              top = std::max(0, tile(pixel.y() - radius_px, down_)),
              bottom = std::min(down_ - 1, tile(pixel.y() + radius_px, down_));
    for (int row = top; row <= bottom; ++row)
      for (int column = left; column <= right; ++column) {
        const size_t t = static_cast<size_t>(row) * across_ + column;
        for (size_t k = first_[t]; k < first_[t + 1]; ++k) visit(edges_[k]);
      }
  }

 private:
  int across_ = 0, down_ = 0;
  std::vector<size_t> first_ = {0};
  std::vector<SurfaceEdge> edges_;
};

struct EdgeGates {
  double scale_mm = 1;  ///< Of the Geman-McClure loss.
  double reach_mm = 2;  ///< Edges further apart are no match.
  size_t step = 1;      ///< Every step-th edge of the source takes part.
  double break_mm = 0;  ///< See EdgeModel.
  /// Variance (rad^2) of a face's normals; see PairSum::tilts.
  double normal_variance = 0;
};

/// Sums over edges, apart by the direction of the residual (part frame): those of one direction belong to few
/// edges of the part, and err alike.
using EdgeSums = std::array<PairSum, 6>;

/// Matches the edges of one scan to those of another: each takes the nearest that bounds a surface of like
/// normal in a like direction; the residual runs across the edge, in the surface.
EdgeSums match_edges(const RangeSurface& target, const EdgeIndex& target_edges, const RangeSurface& source,
                     const Pose& target_from_source, const Pose& part_from_target,
                     const Eigen::Vector3d& centre, const EdgeGates& gates);

/// Matches the edges of one scan to faces of another: where a side of the part ends at a face that only the
/// other scan sees, the end lies in that face, or as far before it as the edge is broken. The residual runs
/// along the face's normal. This is what sets the scans of a plate's two faces against each other when all
/// they share are its thin sides.
EdgeSums match_edges_to_faces(const RangeSurface& target, const RangeSurface& source,
                              const Pose& target_from_source, const Pose& part_from_target,
                              const Eigen::Vector3d& centre, const EdgeGates& gates);

}  // namespace gantry::internal
