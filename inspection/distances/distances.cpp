#include "gantry/inspection/distances.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "distances/earth_movers.h"
#include "distances/local_model.h"
#include "distances/m3c2.h"
#include "distances/sorted_points.h"
#include "distances/statistics.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/spatial_order.h"
#include "gantry/geometry/surface_samples.h"

namespace gantry {

struct DistanceReference::Impl {
  explicit Impl(const PointCloud& given) : cloud(internal::morton_sorted(given)), index(cloud.points) {}
  PointCloud cloud;
  PointIndex index;
  std::optional<SignedDistance> mesh;
};

DistanceReference::DistanceReference(PointCloud cloud) {
  internal::require_points(cloud, "the reference cloud");
  impl_ = std::make_unique<Impl>(cloud);
}

DistanceReference::DistanceReference(TriangleMesh mesh, size_t samples, uint64_t seed) {
  if (samples == 0) throw InputError("the number of points sampled from a reference mesh must be positive");
  if (mesh.triangles.empty()) throw InputError("the reference mesh holds no triangles");
  for (size_t i = 0; i < mesh.vertices.size(); ++i)
    if (!mesh.vertices[i].allFinite())
      throw InputError("the reference mesh: vertex " + std::to_string(i) +
                       " has a coordinate that is not a finite number");
  impl_ = std::make_unique<Impl>(sample_surface(mesh, samples, seed));
  impl_->mesh.emplace(std::move(mesh));
}

DistanceReference::~DistanceReference() = default;
DistanceReference::DistanceReference(DistanceReference&&) noexcept = default;
DistanceReference& DistanceReference::operator=(DistanceReference&&) noexcept = default;

const PointCloud& DistanceReference::cloud() const {
  return impl_->cloud;
}
const PointIndex& DistanceReference::index() const {
  return impl_->index;
}
const SignedDistance* DistanceReference::mesh() const {
  return impl_->mesh ? &*impl_->mesh : nullptr;
}

namespace {

constexpr float kAnywhere = 1e15f;  ///< mm; further than any two points whose squared distance fits a float.

using Neighbours = std::vector<PointIndex::Neighbour>;

void require(bool ok, const std::string& what) {
  if (!ok) throw InputError("compare: " + what);
}

void validate(const DistanceOptions& o) {
  require(o.neighbours >= 3 && o.neighbours <= internal::kMostNeighbours,
          "neighbours: a number from 3 to 64 is expected, found " + std::to_string(o.neighbours));
  require(o.percentile > 0 && o.percentile <= 100,
          "percentile: above 0 and up to 100 is expected, found " + std::to_string(o.percentile));
  require(o.exact_assignment_points > 0 && o.exact_assignment_points <= 20000,
          "exact_assignment_points: a number from 1 to 20000 is expected, found " +
              std::to_string(o.exact_assignment_points));
  const auto length = [](double value, const char* key) {
    require(value >= 0 && std::isfinite(value),
            std::string(key) + ": 0 or more is expected, found " + std::to_string(value));
  };
  length(o.m3c2_normal_diameter_mm, "m3c2_normal_diameter_mm");
  length(o.m3c2_cylinder_diameter_mm, "m3c2_cylinder_diameter_mm");
  length(o.m3c2_depth_mm, "m3c2_depth_mm");
  length(o.registration_mm, "registration_mm");
}

float distance(const Eigen::Vector3f& p, const Eigen::Vector3f& q) {
  return static_cast<float>((p.cast<double>() - q.cast<double>()).norm());
}

double mean_of(std::span<const float> values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

double mean_square_of(std::span<const float> values) {
  double sum = 0;
  for (const double v : values) sum += v * v;
  return sum / static_cast<double>(values.size());
}

/// The mean of those that are there; NaN without any.
double mean_magnitude_of(std::span<const float> values) {
  double sum = 0;
  size_t count = 0;
  for (const float v : values) {
    if (!std::isfinite(v)) continue;
    sum += std::abs(v);
    ++count;
  }
  return sum / static_cast<double>(count);
}

/// `from` is in Morton order.
Neighbours nearest_of(const PointCloud& from, const PointIndex& to) {
  constexpr size_t kRun = 1024;
  Neighbours nearest(from.size());
  tbb::parallel_for(size_t{0}, (from.size() + kRun - 1) / kRun, [&](size_t run) {
    PointIndex::Neighbourhood near;
    for (size_t i = run * kRun; i < std::min(from.size(), (run + 1) * kRun); ++i) {
      const auto one = to.nearest(from.points[i], kAnywhere, near);
      require(one.has_value(), "the clouds are too far apart to be compared");
      nearest[i] = *one;
    }
  });
  return nearest;
}

std::vector<float> distances_to(const PointCloud& from, const PointCloud& to, const Neighbours& nearest) {
  std::vector<float> distances(from.size());
  for (size_t i = 0; i < from.size(); ++i)
    distances[i] = distance(from.points[i], to.points[nearest[i].index]);
  return distances;
}

/// One cloud against one reference, by any number of metrics. Works on A in Morton order; what is found is
/// found at most once.
class Comparison {
 public:
  Comparison(const PointCloud& compared, const DistanceReference& reference, const DistanceOptions& options)
      : options_(options),
        order_(morton_order(compared.points)),
        a_(internal::morton_sorted(compared)),
        b_(reference.cloud()),
        reference_(reference) {}

  DistanceResult result(Metric metric) {
    DistanceResult r;
    r.metric = metric;
    measure(r);
    r.distance_mm = in_given_order(r.distance_mm);
    r.lod95_mm = in_given_order(r.lod95_mm);
    r.summary = internal::summary_of(r.distance_mm);
    return r;
  }

 private:
  void measure(DistanceResult& r) {
    switch (r.metric) {
      case Metric::kChamfer:
      case Metric::kChamferSquared:
      case Metric::kHausdorff:
      case Metric::kPercentileHausdorff:
        return between_nearest(r);
      case Metric::kEarthMovers:
        return earth_movers(r);
      case Metric::kPlane:
        return local_model(r, internal::distance_to_plane, 3);
      case Metric::kQuadric:
        return local_model(r, internal::distance_to_quadric, 6);
      case Metric::kTriangulation:
        return local_model(r, internal::distance_to_triangulation, 3);
      case Metric::kCloudToMesh:
        return cloud_to_mesh(r);
      case Metric::kM3c2:
        return m3c2(r);
    }
  }

  const PointIndex& a_index() {
    if (!a_index_) a_index_.emplace(a_.points);
    return *a_index_;
  }
  const Neighbours& nearest() {
    if (nearest_.empty()) nearest_ = nearest_of(a_, reference_.index());
    return nearest_;
  }
  const std::vector<float>& to_b() {
    if (to_b_.empty()) to_b_ = distances_to(a_, b_, nearest());
    return to_b_;
  }
  const std::vector<float>& to_a() {
    if (to_a_.empty()) to_a_ = distances_to(b_, a_, nearest_of(b_, a_index()));
    return to_a_;
  }

  void between_nearest(DistanceResult& r) {
    r.distance_mm = to_b();
    const auto larger_percentile = [&](double percent) {
      return std::max(internal::percentile(internal::sorted_finite(to_b()), percent),
                      internal::percentile(internal::sorted_finite(to_a()), percent));
    };
    if (r.metric == Metric::kChamfer) {
      r.value = (mean_of(to_b()) + mean_of(to_a())) / 2;
    } else if (r.metric == Metric::kChamferSquared) {
      r.value = mean_square_of(to_b()) + mean_square_of(to_a());
    } else {
      r.value = larger_percentile(r.metric == Metric::kHausdorff ? 100 : options_.percentile);
    }
  }

  void earth_movers(DistanceResult& r) {
    internal::EarthMovers found =
        internal::earth_movers(a_.points, b_.points, options_.exact_assignment_points);
    r.value = found.mean_mm;
    r.error_bound_mm = found.error_bound_mm;
    r.distance_mm = std::move(found.distance_mm);
    if (found.group > 1)
      r.note = "approximate: every " + std::to_string(found.group) + " neighbours stand as one";
    if (a_.size() != b_.size())
      r.note += (r.note.empty() ? "" : "; ") + std::string("the clouds have ") + std::to_string(a_.size()) +
                " and " + std::to_string(b_.size()) +
                " points: only as many as the smaller has find partners";
  }

  void local_model(DistanceResult& r, internal::LocalModel model, size_t least) {
    const std::string name(to_string(r.metric));
    const size_t k = options_.neighbours;
    require(k >= least,
            name + " needs " + std::to_string(least) + " neighbours at least, found " + std::to_string(k));
    require(k <= b_.size(), name + ": " + std::to_string(k) +
                                " neighbours are asked for, but the reference cloud has only " +
                                std::to_string(b_.size()) + " points");
    r.distance_mm.resize(a_.size());
    const Neighbours& centre = nearest();
    tbb::parallel_for(size_t{0}, a_.size(), [&](size_t i) {
      thread_local Neighbours found;
      thread_local std::vector<Eigen::Vector3d> around;
      const Eigen::Vector3f& nearest_point = b_.points[centre[i].index];
      reference_.index().nearest(nearest_point, k, kAnywhere, found);
      around.clear();
      for (const auto& n : found) around.push_back(b_.points[n.index].cast<double>());
      const auto to_model = model(around, a_.points[i].cast<double>());
      const float to_nearest = distance(a_.points[i], nearest_point);
      r.distance_mm[i] = to_model ? std::min(static_cast<float>(*to_model), to_nearest) : to_nearest;
    });
    r.value = mean_of(r.distance_mm);
  }

  void cloud_to_mesh(DistanceResult& r) {
    require(reference_.mesh(), "cloud-to-mesh needs a mesh as the reference, not a cloud");
    r.distance_mm.resize(a_.size());
    std::atomic<size_t> beside_border = 0;
    for_each_run(a_.points, [&](std::span<const uint32_t> run) {
      SurfaceIndex::Neighbourhood near;
      for (const uint32_t i : run) {
        const auto value = (*reference_.mesh())(a_.points[i], kAnywhere, near);
        require(value.has_value(), "the cloud is too far from the mesh to be compared");
        r.distance_mm[i] = value->distance;
        if (value->at_border) ++beside_border;
      }
    });
    r.beside_border = beside_border;
    r.value = mean_magnitude_of(r.distance_mm);
  }

  void m3c2(DistanceResult& r) {
    internal::M3c2 found = internal::m3c2(a_, a_index(), b_, reference_.index(), nearest(), options_);
    r.distance_mm = std::move(found.distance_mm);
    r.lod95_mm = std::move(found.lod95_mm);
    r.note = std::move(found.note);
    r.value = mean_magnitude_of(r.distance_mm);
  }

  std::vector<float> in_given_order(const std::vector<float>& sorted) const {
    std::vector<float> given(sorted.size());
    for (size_t i = 0; i < sorted.size(); ++i) given[order_[i]] = sorted[i];
    return given;
  }

  const DistanceOptions& options_;
  std::vector<uint32_t> order_;
  PointCloud a_;
  const PointCloud& b_;
  const DistanceReference& reference_;
  std::optional<PointIndex> a_index_;
  Neighbours nearest_;              ///< Of each point of A, in B.
  std::vector<float> to_b_, to_a_;  ///< d(a, B) and d(b, A).
};

}  // namespace

DistanceResult compare(const PointCloud& compared, const DistanceReference& reference, Metric metric,
                       const DistanceOptions& options) {
  return std::move(compare(compared, reference, std::span(&metric, 1), options).front());
}

std::vector<DistanceResult> compare(const PointCloud& compared, const DistanceReference& reference,
                                    std::span<const Metric> metrics, const DistanceOptions& options) {
  internal::require_points(compared, "the compared cloud");
  validate(options);
  Comparison comparison(compared, reference, options);
  std::vector<DistanceResult> results;
  for (const Metric metric : metrics) results.push_back(comparison.result(metric));
  return results;
}

}  // namespace gantry
