#include "gantry/inspection/inspection.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "cad_faces/patch_statistics.h"
#include "defects/find_defects.h"
#include "defects/unjudged.h"
#include "fixture.h"
#include "gantry/foundation/error.h"
#include "gantry/geometry/spatial_order.h"
#include "local_surface.h"
#include "surface_coverage.h"
#include "uncertainty/deviation_uncertainty.h"
#include "verdict.h"

namespace gantry {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr size_t kBudgetPoints = 100000;  ///< So many tell what a typical point is uncertain by.

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
  require(o.systematic_sigma_mm >= 0, "systematic_sigma_mm must not be negative");
  require(o.min_unseen_area_mm2 >= 0, "the least area of surface without data must not be negative");
  require(o.fixture_margin_mm >= 0, "the margin of the fixture must not be negative");
  require(o.guard_band >= 0 && o.guard_band <= 10, "the guard band is 0 to 10 standard uncertainties");
  require(o.min_coverage >= 0 && o.min_coverage <= 1, "the least coverage is a fraction from 0 to 1");
}

PointCloud transformed(const PointCloud& cloud, const Pose& pose) {
  PointCloud out = cloud;
  out.sources = nullptr;  // these know errors in the frame of before
  tbb::parallel_for(size_t{0}, out.size(), [&](size_t i) {
    out.points[i] = (pose * cloud.points[i].cast<double>()).cast<float>();
    if (cloud.has_normals()) out.normals[i] = (pose.linear() * cloud.normals[i].cast<double>()).cast<float>();
  });
  return out;
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

/// Standard uncertainties of the median point, each part by itself.
UncertaintyBudget medians_of(const std::vector<std::optional<UncertaintyBudget>>& variances) {
  UncertaintyBudget median;
  for (double UncertaintyBudget::*part : {&UncertaintyBudget::noise, &UncertaintyBudget::scan_poses,
                                          &UncertaintyBudget::alignment, &UncertaintyBudget::sensor}) {
    std::vector<double> values;
    for (const auto& v : variances)
      if (v) values.push_back((*v).*part);
    if (values.empty()) break;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    median.*part = std::sqrt(*middle);
  }
  return median;
}

}  // namespace

InspectionResult inspect(const PointCloud& cloud, const SignedDistance& reference,
                         const InspectionOptions& options) {
  validate(cloud, options);
  InspectionResult result;
  const internal::Fixture fixture(options);
  const std::vector<float> to_fixture = fixture.distances(
      cloud.points, static_cast<float>(options.max_distance_mm + options.fixture_margin_mm));

  if (options.align) {
    std::vector<uint32_t> free_of_fixture;
    for (uint32_t i = 0; i < cloud.size(); ++i)
      if (!(to_fixture[i] < options.fixture_margin_mm)) free_of_fixture.push_back(i);
    const PointCloud free = select(cloud, free_of_fixture);
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
  internal::JudgedFeet feet(n);
  const internal::DeviationUncertainty uncertainty(result.cloud, cloud.sources.get(), surface,
                                                   result.alignment, options.systematic_sigma_mm);
  const size_t every = 1 + n / kBudgetPoints;
  std::vector<std::optional<UncertaintyBudget>> samples(n / every + 1);
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
      const UncertaintyBudget v = uncertainty.variances(i, *value);
      if (i % every == 0) samples[i / every] = v;
      result.uncertainty_mm[i] =
          static_cast<float>(std::sqrt(v.noise + v.scan_poses + v.alignment + v.sensor));
      feet.stand(i, *value, surface.points[i], cloud.has_normals() ? &result.cloud.normals[i] : nullptr,
                 reference.mesh(), options.tolerance_mm);
    } else if (value && value->at_border) {
      beside_border[i] = 1;
    }
  };
  for_each_run(surface.points, [&](std::span<const uint32_t> run) {
    SurfaceIndex::Neighbourhood near;
    for (const uint32_t i : run) {
      const Eigen::Vector3f& p = surface.points[i];
      const auto value = cloud.has_normals() ? reference(p, result.cloud.normals[i], min_cosine, reach, near)
                                             : reference(p, reach, near);
      judge(i, value);
    }
  });

  result.topology = analyse_topology(reference.mesh());
  result.beside_border =
      static_cast<size_t>(std::count(beside_border.begin(), beside_border.end(), uint8_t{1}));
  result.budget = medians_of(samples);
  if (cloud.sources) result.doubt = cloud.sources->doubt;
  result.poses_known = cloud.sources && cloud.sources->pose_covariance.size() > 0;
  result.statistics = statistics_of(result.deviation_mm, options.tolerance_mm);
  const internal::CoverageSamples coverage = internal::sample_coverage(reference, feet, 1.0);
  result.coverage = coverage.fraction();
  const CadFaces cad = segment_faces(reference.mesh());
  internal::measure_surface(result, reference.mesh(), cad, feet, coverage);
  internal::find_unjudged(result, cad, coverage, fixture, options);
  internal::find_defects(result, surface, reference, cad, feet, coverage, options, cloud.sources.get());
  internal::decide(result, options);
  return result;
}

}  // namespace gantry
