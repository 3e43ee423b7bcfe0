#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace gantry {

/// Nearest neighbours of a fixed set of points (kd-tree by nanoflann). The points must outlive the
/// index. Queries are thread-safe.
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
  /// The one nearest within `max_distance`, if any; of equally near ones any. `guess`, if not negative, is the
  /// index of a point that may be it, such as the answer for a neighbouring query: it saves most of the time.
  std::optional<Neighbour> nearest(const Eigen::Vector3f& query, float max_distance, int guess = -1) const;
  /// All neighbours within the radius, in no particular order.
  void within(const Eigen::Vector3f& query, float radius, std::vector<Neighbour>& out) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace gantry
