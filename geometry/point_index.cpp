#include "gantry/geometry/point_index.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nanoflann.hpp>

namespace gantry {
namespace {

struct Adaptor {
  std::span<const Eigen::Vector3f> points;
  size_t kdtree_get_point_count() const { return points.size(); }
  float kdtree_get_pt(size_t i, size_t axis) const { return points[i][static_cast<Eigen::Index>(axis)]; }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree =
    nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Adaptor>, Adaptor, 3, uint32_t>;

/// One neighbour, sought from a distance on that is known to suffice.
struct NearestOne {
  float squared;
  uint32_t index = 0;
  bool found = false;

  bool full() const { return true; }
  float worstDist() const { return squared; }
  bool addPoint(float d, uint32_t i) {
    if (d < squared) {
      squared = d;
      index = i;
      found = true;
    }
    return true;
  }
};

}  // namespace

struct PointIndex::Impl {
  explicit Impl(std::span<const Eigen::Vector3f> points)
      : adaptor{points}, tree(3, adaptor, nanoflann::KDTreeSingleIndexAdaptorParams(16)) {
    if (!points.empty()) tree.buildIndex();
  }
  Adaptor adaptor;
  Tree tree;
};

PointIndex::PointIndex(std::span<const Eigen::Vector3f> points) : impl_(std::make_unique<Impl>(points)) {}
PointIndex::~PointIndex() = default;
PointIndex::PointIndex(PointIndex&&) noexcept = default;
PointIndex& PointIndex::operator=(PointIndex&&) noexcept = default;

void PointIndex::nearest(const Eigen::Vector3f& query, size_t k, float max_distance,
                         std::vector<Neighbour>& out) const {
  out.clear();
  if (impl_->adaptor.points.empty() || k == 0) return;
  thread_local std::vector<uint32_t> indices;
  thread_local std::vector<float> squared;
  indices.resize(k);
  squared.resize(k);
  nanoflann::KNNResultSet<float, uint32_t> result(k);
  result.init(indices.data(), squared.data());
  impl_->tree.findNeighbors(result, query.data(), nanoflann::SearchParams());
  const float limit = max_distance * max_distance;
  for (size_t i = 0; i < result.size() && squared[i] <= limit; ++i) out.push_back({indices[i], squared[i]});
}

std::optional<PointIndex::Neighbour> PointIndex::nearest(const Eigen::Vector3f& query, float max_distance,
                                                         int guess) const {
  const auto& points = impl_->adaptor.points;
  if (points.empty()) return std::nullopt;
  const float limit = max_distance * max_distance;
  NearestOne one{std::nextafter(limit, std::numeric_limits<float>::infinity())};
  if (guess >= 0 && static_cast<size_t>(guess) < points.size())
    one.addPoint((points[static_cast<size_t>(guess)] - query).squaredNorm(), static_cast<uint32_t>(guess));
  impl_->tree.findNeighbors(one, query.data(), nanoflann::SearchParams());
  if (!one.found) return std::nullopt;
  return Neighbour{one.index, one.squared};
}

void PointIndex::within(const Eigen::Vector3f& query, float radius, std::vector<Neighbour>& out) const {
  out.clear();
  if (impl_->adaptor.points.empty()) return;
  thread_local std::vector<std::pair<uint32_t, float>> found;
  found.clear();
  impl_->tree.radiusSearch(query.data(), radius * radius, found, nanoflann::SearchParams(32, 0.0f, false));
  out.reserve(found.size());
  for (const auto& [index, squared] : found) out.push_back({index, squared});
}

}  // namespace gantry
