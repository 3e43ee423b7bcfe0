#include "gantry/geometry/point_index.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>
#include <nanoflann.hpp>

#include "gantry/geometry/spatial_order.h"
#include "large_pages.h"

namespace gantry {
namespace {

/// The points in the order of a curve through space: what the tree holds together lies together.
struct SortedPoints {
  explicit SortedPoints(std::span<const Eigen::Vector3f> given)
      : order(morton_order(given)), points(given.size()) {
    tbb::parallel_for(size_t{0}, order.size(), [&](size_t i) { points[i] = given[order[i]]; });
  }
  size_t kdtree_get_point_count() const { return points.size(); }
  float kdtree_get_pt(size_t i, size_t axis) const { return points[i][static_cast<Eigen::Index>(axis)]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }

  std::vector<uint32_t> order;  ///< Where among the given points each was.
  internal::LargeVector<Eigen::Vector3f> points;
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, SortedPoints>,
                                                 SortedPoints, 3, uint32_t>;

/// One neighbour, sought from a distance on that is known to suffice.
struct NearestOne {
  float squared;
  std::optional<uint32_t> found = {};

  bool full() const { return true; }
  float worstDist() const { return squared; }
  bool addPoint(float d, uint32_t i) {
    if (d < squared) {
      squared = d;
      found = i;
    }
    return true;
  }
};

}  // namespace

struct PointIndex::Impl {
  explicit Impl(std::span<const Eigen::Vector3f> points)
      : sorted(points), tree(3, sorted, nanoflann::KDTreeSingleIndexAdaptorParams(16)) {
    if (!points.empty()) tree.buildIndex();
  }
  SortedPoints sorted;
  Tree tree;
};

PointIndex::PointIndex(std::span<const Eigen::Vector3f> points) : impl_(std::make_unique<Impl>(points)) {}
PointIndex::~PointIndex() = default;
PointIndex::PointIndex(PointIndex&&) noexcept = default;
PointIndex& PointIndex::operator=(PointIndex&&) noexcept = default;

void PointIndex::nearest(const Eigen::Vector3f& query, size_t k, float max_distance,
                         std::vector<Neighbour>& out) const {
  out.clear();
  if (impl_->sorted.points.empty() || k == 0) return;
  thread_local std::vector<uint32_t> indices;
  thread_local std::vector<float> squared;
  indices.resize(k);
  squared.resize(k);
  nanoflann::KNNResultSet<float, uint32_t> result(k);
  result.init(indices.data(), squared.data());
  impl_->tree.findNeighbors(result, query.data(), nanoflann::SearchParams());
  const float limit = max_distance * max_distance;
  for (size_t i = 0; i < result.size() && squared[i] <= limit; ++i)
    out.push_back({impl_->sorted.order[indices[i]], squared[i]});
}

std::optional<PointIndex::Neighbour> PointIndex::nearest(const Eigen::Vector3f& query,
                                                         float max_distance) const {
  Neighbourhood unknown;
  return nearest(query, max_distance, unknown);
}

std::optional<PointIndex::Neighbour> PointIndex::nearest(const Eigen::Vector3f& query, float max_distance,
                                                         Neighbourhood& near) const {
  const auto& [order, points] = impl_->sorted;
  if (near.slot_ >= points.size()) return std::nullopt;
  NearestOne one{std::nextafter(max_distance * max_distance, std::numeric_limits<float>::infinity())};
  one.addPoint((points[near.slot_] - query).squaredNorm(), near.slot_);
  impl_->tree.findNeighbors(one, query.data(), nanoflann::SearchParams());
  if (!one.found) return std::nullopt;
  near.slot_ = *one.found;
  return Neighbour{order[*one.found], one.squared};
}

void PointIndex::within(const Eigen::Vector3f& query, float radius, std::vector<Neighbour>& out) const {
  out.clear();
  if (impl_->sorted.points.empty()) return;
  thread_local std::vector<std::pair<uint32_t, float>> found;
  found.clear();
  impl_->tree.radiusSearch(query.data(), radius * radius, found, nanoflann::SearchParams(32, 0.0f, false));
  out.reserve(found.size());
  for (const auto& [index, squared] : found) out.push_back({impl_->sorted.order[index], squared});
}

}  // namespace gantry
