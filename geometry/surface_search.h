#pragma once

#include <optional>

#include "gantry/geometry/surface_index.h"
#include "surface_tree.h"

namespace gantry::internal {

/// Which triangles count.
struct Facing {
  bool asked = false;  ///< Whether only those whose normal has so large a cosine to the direction.
  Eigen::Vector3f direction = Eigen::Vector3f::Zero();
  float min_cosine = 0;
};

/// What a series of queries learns, each close to the one before: the block of the closest triangle, and the
/// blocks of the tree that come near a ball. A query inside the ball needs to look at these only, as long as
/// the surface is closer to its point than the ball's rim is.
class Surroundings {
 public:
  static constexpr int kMostBlocks = 6 * kLanes;

  int nearest_block = -1;             ///< Of the answer before; negative: none yet.
  const SurfaceTree* tree = nullptr;  ///< That it is of.

  /// Whether all that lies within `reach` of the point is among the blocks.
  bool serve(const Eigen::Vector3f& point, float reach);
  /// Gathers the blocks near a ball around the point: a large one, but of no more blocks than are quickly
  /// gone through, and only where others before have paid.
  void gather(const Eigen::Vector3f& point, float reach);

  int groups() const { return (count_ + kLanes - 1) / kLanes; }
  const Lanes3& low(int group) const { return low_[group]; }
  const Lanes3& high(int group) const { return high_[group]; }
  const int* blocks(int group) const { return block_ + group * kLanes; }

 private:
  static constexpr int kWorthwhile = 4;  ///< Queries that pay for gathering.
  static constexpr int kPause = 32;      ///< Queries until it is tried again.

  bool collect(float radius);

  Eigen::Vector3f centre_ = Eigen::Vector3f::Zero();
  float radius_ = 0;         ///< Of the ball; zero: there is none.
  float wanted_radius_ = 0;  ///< Of the next one.
  int uses_ = 0, pause_ = 0;
  int count_ = 0;
  Lanes3 low_[kMostBlocks / kLanes], high_[kMostBlocks / kLanes];
  int block_[kMostBlocks];
};

/// The closest point of the triangles that count, within `max_distance`. `near_triangle` may be negative and
/// `near` null.
std::optional<SurfaceIndex::Closest> search(const SurfaceTree& tree, const TriangleMesh& mesh,
                                            const Eigen::Vector3f& point, float max_distance,
                                            const Facing& facing, int near_triangle, Surroundings* near);

}  // namespace gantry::internal
