#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace gantry {

/// Nearest neighbours of a fixed set of points (kd-tree by nanoflann, over a copy of the points in the order
/// of a curve through space). Queries are thread-safe.
class PointIndex {
 public:
  struct Neighbour {
    uint32_t index;
    float squared_distance;
  };

  explicit PointIndex(std::span<const Eigen::Vector3f> points);
  ~PointIndex();
  PointIndex(PointIndex&&) noexcept;
  PointIndex& operator=(PointIndex&&) noexcept;

  /// Up to k neighbours within `max_distance`, nearest first, written to `out` (cleared first).
  void nearest(const Eigen::Vector3f& query, size_t k, float max_distance, std::vector<Neighbour>& out) const;
  /// What a series of queries remembers, each close to the one before: it saves most of the time. For one
  /// index and one thread.
  class Neighbourhood {
    friend class PointIndex;
    uint32_t slot_ = 0;  ///< Of the answer before.
  };
  /// The one nearest within `max_distance`, if any; of equally near ones any.
  std::optional<Neighbour> nearest(const Eigen::Vector3f& query, float max_distance) const;
  std::optional<Neighbour> nearest(const Eigen::Vector3f& query, float max_distance,
                                   Neighbourhood& near) const;
  /// All neighbours within the radius, in no particular order.
  void within(const Eigen::Vector3f& query, float radius, std::vector<Neighbour>& out) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
