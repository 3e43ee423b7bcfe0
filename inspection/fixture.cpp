#include "fixture.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "gantry/foundation/error.h"
#include "gantry/geometry/point_index.h"
#include "gantry/geometry/spatial_order.h"
#include "gantry/geometry/surface_index.h"

namespace gantry::internal {
namespace {

constexpr size_t kSupport = 6;         ///< A point of the scan counts with so many others ...
constexpr double kSupportReach = 4.0;  ///< ... within so many times the points' spacing.

double median_spacing(const PointCloud& scan, const PointIndex& index) {
  std::vector<double> spacing;
  std::vector<PointIndex::Neighbour> two;
  const size_t stride = scan.size() / 5000 + 1;
  for (size_t i = 0; i < scan.size(); i += stride) {
    index.nearest(scan.points[i], 2, 1e9f, two);
    spacing.push_back(std::sqrt(two.back().squared_distance));
  }
  const auto middle = spacing.begin() + static_cast<std::ptrdiff_t>(spacing.size() / 2);
  std::nth_element(spacing.begin(), middle, spacing.end());
  return *middle;
}

}  // namespace

/// A scan of the empty fixture, without the points that stand alone.
struct Fixture::Learned {
  PointCloud scan;
  std::unique_ptr<PointIndex> index;
  float spacing_mm = 0;

  explicit Learned(const PointCloud& given) {
    if (given.points.empty()) throw InputError("inspection: the scan of the empty fixture holds no points");
    const PointIndex all(given.points);
    const double spacing = median_spacing(given, all);
    std::vector<unsigned char> supported(given.size(), 0);
    tbb::parallel_for(size_t{0}, given.size(), [&](size_t i) {
      thread_local std::vector<PointIndex::Neighbour> near;
      all.nearest(given.points[i], kSupport + 1, static_cast<float>(kSupportReach * spacing), near);
      supported[i] = near.size() == kSupport + 1;
    });
    for (size_t i = 0; i < given.size(); ++i) {
      if (!supported[i]) continue;
      scan.points.push_back(given.points[i]);
      if (given.has_normals()) scan.normals.push_back(given.normals[i]);
    }
    if (scan.points.empty())
      throw InputError("inspection: the scan of the empty fixture holds scattered points only, no surface");
    index = std::make_unique<PointIndex>(scan.points);
    spacing_mm = static_cast<float>(spacing);
  }

  /// Between the points of the scan there is surface: sideways, their spacing does not count.
  float distance(const Eigen::Vector3f& p, const PointIndex::Neighbour& nearest) const {
    const float direct = std::sqrt(nearest.squared_distance);
    if (!scan.has_normals()) return std::max(0.0f, direct - spacing_mm);
    const float across = std::abs((p - scan.points[nearest.index]).dot(scan.normals[nearest.index]));
    const float sideways = std::sqrt(std::max(0.0f, direct * direct - across * across));
    return std::hypot(across, std::max(0.0f, sideways - spacing_mm));
  }
};

Fixture::Fixture(const InspectionOptions& options) {
  if (options.fixture) mesh_ = std::make_unique<SurfaceIndex>(*options.fixture);
  if (options.fixture_scan) learned_ = std::make_unique<Learned>(*options.fixture_scan);
}

Fixture::~Fixture() = default;

bool Fixture::known() const {
  return mesh_ || learned_;
}

std::vector<float> Fixture::distances(const std::vector<Eigen::Vector3f>& points, float reach_mm) const {
  std::vector<float> distances(points.size(), std::numeric_limits<float>::infinity());
  if (!known()) return distances;
  for_each_run(points, [&](std::span<const uint32_t> run) {
    SurfaceIndex::Neighbourhood near;
    PointIndex::Neighbourhood near_scan;
    for (const uint32_t i : run) {
      if (mesh_)
        if (const auto closest = mesh_->closest(points[i], reach_mm, near)) distances[i] = closest->distance;
      if (!learned_) continue;
      const auto nearest = learned_->index->nearest(points[i], reach_mm, near_scan);
      if (!nearest) continue;
      distances[i] = std::min(distances[i], learned_->distance(points[i], *nearest));
    }
  });
  return distances;
}

}  // namespace gantry::internal
