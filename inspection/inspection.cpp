#include "gantry/inspection/inspection.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "defects.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/spatial_order.h"
#include "gantry/geometry/surface_index.h"
#include "local_surface.h"
#include "surface_coverage.h"

namespace gantry {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr double kLeastFit = 0.3;  ///< A fit to fewer of the points than this is no alignment.

void validate(const PointCloud& cloud, const InspectionOptions& o) {
  const auto require = [](bool ok, const std::string& what) {
    if (!ok) throw InputError("inspection: " + what);
  };
  require(!cloud.points.empty(), "the cloud holds no points");
  require(o.tolerance_mm > 0, "the tolerance must be positive");
  require(o.max_distance_mm > o.tolerance_mm, "the largest distance must exceed the tolerance");
  require(o.symmetry_tolerance_mm >= 0, "the tolerance of symmetries must not be negative");
  require(o.averaging_radius_mm >= 0, "the averaging radius must not be negative");
  require(o.link_distance_mm > 0, "the linking distance must be positive");
  require(o.min_coverage >= 0 && o.min_coverage <= 1, "the least coverage is a fraction from 0 to 1");
}

PointCloud transformed(const PointCloud& cloud, const Pose& pose) {
  PointCloud out = cloud;
  tbb::parallel_for(size_t{0}, out.size(), [&](size_t i) {
    out.points[i] = (pose * cloud.points[i].cast<double>()).cast<float>();
    if (cloud.has_normals()) out.normals[i] = (pose.linear() * cloud.normals[i].cast<double>()).cast<float>();
  });
  return out;
}

/// Each point's distance to the fixture, infinite where there is none near.
std::vector<float> fixture_distances(const PointCloud& cloud, const InspectionOptions& options) {
  std::vector<float> distances(cloud.size(), std::numeric_limits<float>::infinity());
  if (!options.fixture) return distances;
  const SurfaceIndex fixture(*options.fixture);
  const auto reach = static_cast<float>(options.max_distance_mm + options.fixture_margin_mm);
  for_each_run(cloud.points, [&](std::span<const uint32_t> run) {
    int near = -1;
    for (const uint32_t i : run) {
      const auto closest = fixture.closest(cloud.points[i], reach, near);
      if (!closest) continue;
      distances[i] = closest->distance;
      near = closest->triangle;
    }
  });
  return distances;
}

DeviationStatistics statistics_of(std::vector<float> values, double tolerance_mm) {
  DeviationStatistics s;
  std::erase_if(values, [](float v) { return !std::isfinite(v); });
  s.count = values.size();
  if (values.empty()) return s;
  std::sort(values.begin(), values.end());
  double sum = 0, squares = 0;
  size_t within = 0;
  for (float v : values) {
    sum += v;
    squares += static_cast<double>(v) * v;
    within += std::abs(v) <= tolerance_mm;
  }
  const double n = static_cast<double>(values.size());
  s.mean = sum / n;
  s.rms = std::sqrt(squares / n);
  s.sigma = std::sqrt(std::max(0.0, squares / n - s.mean * s.mean));
  s.min = values.front();
  s.max = values.back();
  const auto percentile = [&](double p) { return values[static_cast<size_t>(p * (n - 1))]; };
  s.p05 = percentile(0.05);
  s.p50 = percentile(0.50);
  s.p95 = percentile(0.95);
  s.within_tolerance = static_cast<double>(within) / n;
  return s;
}

/// Variance of a point's deviation along `direction` that the alignment brings. A free motion slides the part
/// along itself: it counts only where it would move the surface across itself, at a rim for example.
double alignment_variance(const AlignmentResult& alignment, const Eigen::Vector3d& point,
                          const Eigen::Vector3d& direction) {
  constexpr double kAlongItself = 0.1;  // mm across for each mm of the motion, about 6 degrees
  Vector6d j;
  j << point.cross(direction), direction;
  for (const FreeMotion& free : alignment.free_motions)
    if (std::abs(j.dot(free.twist)) > kAlongItself) return j.dot(alignment.covariance * j);
  return j.dot(alignment.held_covariance * j);
}

/// Standard uncertainty of one deviation: the smoothed surface's along its normal, the single point's
/// across it (a point beyond an edge deviates sideways, where nothing was smoothed), the alignment's,
/// and what neighbours share.
float standard_uncertainty(const InspectionResult& result, const InspectionOptions& options, size_t i,
                           const internal::LocalSurface& surface, const SignedDistance::Value& value) {
  const Eigen::Vector3d offset = (surface.points[i] - value.closest).cast<double>();
  const Eigen::Vector3d direction =
      offset.norm() > 1e-6 ? Eigen::Vector3d(offset.normalized()) : value.normal.cast<double>();
  double along = 1;
  if (result.cloud.has_normals()) along = direction.dot(result.cloud.normals[i].cast<double>());
  const double single = result.cloud.has_sigma() ? result.cloud.sigma_mm[i] : surface.sigma_mm[i];
  const double variance = along * along * surface.sigma_mm[i] * surface.sigma_mm[i] +
                          (1 - along * along) * single * single +
                          alignment_variance(result.alignment, value.closest.cast<double>(), direction) +
                          options.systematic_sigma_mm * options.systematic_sigma_mm;
  return static_cast<float>(std::sqrt(std::max(0.0, variance)));
}

void decide(InspectionResult& result, const InspectionOptions& options) {
  char text[200];
  const auto certain =
      std::count_if(result.defects.begin(), result.defects.end(), [](const Defect& d) { return d.certain; });
  if (options.align && !result.alignment.converged && result.alignment.inlier_fraction < kLeastFit) {
    result.verdict = Verdict::kUndecided;
    std::snprintf(
        text, sizeof text,
        "The alignment to the CAD model failed: is the cloud of this part, in this frame and unit?");
  } else if (certain > 0) {
    result.verdict = Verdict::kFail;
    std::snprintf(text, sizeof text, "%ld %s out of tolerance (±%.3f mm); the largest deviates by %+.3f mm.",
                  static_cast<long>(certain), certain == 1 ? "region is" : "regions are",
                  options.tolerance_mm, result.defects.front().peak_mm);
  } else if (options.align && !result.alignment.converged) {
    result.verdict = Verdict::kUndecided;
    std::snprintf(text, sizeof text, "The alignment to the CAD model is not to be relied on: %s.",
                  result.alignment.status.c_str());
  } else if (result.coverage < options.min_coverage) {
    result.verdict = Verdict::kUndecided;
    std::snprintf(text, sizeof text,
                  "Only %.0f %% of the CAD surface was seen; at least %.0f %% is asked for.",
                  100 * result.coverage, 100 * options.min_coverage);
  } else if (!result.defects.empty()) {
    result.verdict = Verdict::kUndecided;
    std::snprintf(text, sizeof text,
                  "%zu region(s) exceed the tolerance (±%.3f mm) by less than the uncertainty.",
                  result.defects.size(), options.tolerance_mm);
  } else {
    result.verdict = Verdict::kPass;
    std::snprintf(text, sizeof text,
                  "All of the inspected surface (%.0f %% of the CAD surface) is within ±%.3f mm.",
                  100 * result.coverage, options.tolerance_mm);
  }
  result.reason = text;
}

}  // namespace

std::string_view to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::kPass:
      return "PASS";
    case Verdict::kFail:
      return "FAIL";
    case Verdict::kUndecided:
      return "UNDECIDED";
  }
  return "UNDECIDED";
}

InspectionResult inspect(const PointCloud& cloud, const SignedDistance& reference,
                         const InspectionOptions& options) {
  validate(cloud, options);
  InspectionResult result;
  const std::vector<float> to_fixture = fixture_distances(cloud, options);

  if (options.align) {
    PointCloud free;  // of the fixture
    for (size_t i = 0; i < cloud.size(); ++i) {
      if (to_fixture[i] < options.fixture_margin_mm) continue;
      free.points.push_back(cloud.points[i]);
      if (cloud.has_normals()) free.normals.push_back(cloud.normals[i]);
      if (cloud.has_sigma()) free.sigma_mm.push_back(cloud.sigma_mm[i]);
    }
    result.alignment = align_to_model(free, reference, options.alignment);
    if (options.datums && result.alignment.converged)
      result.alignment =
          align_to_datums(free, reference, *options.datums, result.alignment, options.alignment);
    if (options.symmetry_tolerance_mm > 0 && result.alignment.converged)
      result.alignment.equivalents = find_symmetries(reference, options.symmetry_tolerance_mm);
  } else {
    result.alignment.converged = true;
  }
  result.cloud = transformed(cloud, result.alignment.cad_from_cloud);

  const size_t n = cloud.size();
  const internal::LocalSurface surface =
      internal::fit_local_surface(result.cloud, options.averaging_radius_mm, options.systematic_sigma_mm);
  result.deviation_mm.assign(n, kNaN);
  result.uncertainty_mm.assign(n, kNaN);
  result.point_class.assign(n, PointClass::kFar);
  std::vector<Eigen::Vector3f> foot(n), foot_normal(n);
  std::vector<uint8_t> beside_border(n, 0);
  const auto min_cosine = static_cast<float>(std::cos(options.max_angle_rad));
  const auto reach = static_cast<float>(options.max_distance_mm);
  const auto judge = [&](size_t i, const std::optional<SignedDistance::Value>& value) {
    const float distance = value ? std::abs(value->distance) : std::numeric_limits<float>::infinity();
    if (to_fixture[i] < std::max(static_cast<float>(options.fixture_margin_mm), distance) &&
        std::isfinite(to_fixture[i])) {
      result.point_class[i] = PointClass::kFixture;
    } else if (value && !value->at_border && surface.supported[i]) {
      result.point_class[i] = PointClass::kJudged;
      result.deviation_mm[i] = value->distance;
      result.uncertainty_mm[i] = standard_uncertainty(result, options, i, surface, *value);
      foot[i] = value->closest;
      foot_normal[i] = reference.mesh().normal(value->triangle);
    } else if (value && value->at_border) {
      beside_border[i] = 1;
    }
  };
  for_each_run(surface.points, [&](std::span<const uint32_t> run) {
    int near = -1;
    for (const uint32_t i : run) {
      const Eigen::Vector3f& p = surface.points[i];
      const auto value = cloud.has_normals() ? reference(p, result.cloud.normals[i], min_cosine, reach, near)
                                             : reference(p, reach, near);
      if (value) near = value->triangle;
      judge(i, value);
    }
  });
  PointCloud feet;  // where the judged points stand on the CAD surface
  for (size_t i = 0; i < n; ++i) {
    if (result.point_class[i] != PointClass::kJudged) continue;
    feet.points.push_back(foot[i]);
    feet.normals.push_back(foot_normal[i]);
  }

  result.topology = analyse_topology(reference.mesh());
  result.beside_border =
      static_cast<size_t>(std::count(beside_border.begin(), beside_border.end(), uint8_t{1}));
  result.statistics = statistics_of(result.deviation_mm, options.tolerance_mm);
  result.coverage = internal::surface_coverage(reference.mesh(), feet, 1.0);
  internal::find_defects(result, surface, reference, options);
  decide(result, options);
  return result;
}

}  // namespace gantry
