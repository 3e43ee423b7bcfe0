#include "report/distribution.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace gantry::report {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

template <typename Fit>
double misfit(const std::vector<float>& sorted, const Fit& fit) {
  const auto n = static_cast<double>(sorted.size());
  double worst = 0;
  for (size_t i = 0; i < sorted.size(); ++i) {
    const double expected = fit.probability(sorted[i]);
    worst =
        std::max({worst, expected - static_cast<double>(i) / n, static_cast<double>(i + 1) / n - expected});
  }
  return worst;
}

double misfit(const std::vector<float>& sorted, const Gaussian& fit) {
  if (sorted.empty() || !(fit.sigma_mm > 0)) return kNaN;
  return misfit<Gaussian>(sorted, fit);
}

/// Of sorted values, between the two nearest.
double percentile(const std::vector<float>& sorted, double percent) {
  if (sorted.empty()) return kNaN;
  const double at = percent / 100 * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<size_t>(at);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  const double share = at - static_cast<double>(below);
  return (1 - share) * sorted[below] + share * sorted[above];
}

}  // namespace

double Gaussian::probability(double mm) const {
  return 0.5 * std::erfc(-(mm - mean_mm) / (sigma_mm * std::numbers::sqrt2));
}

Distribution distribution(const InspectionResult& result) {
  Distribution d;
  for (size_t i = 0; i < result.deviation_mm.size(); ++i)
    if (result.point_class[i] == PointClass::kJudged && std::isfinite(result.deviation_mm[i]))
      d.sorted_mm.push_back(result.deviation_mm[i]);
  std::sort(d.sorted_mm.begin(), d.sorted_mm.end());
  d.magnitudes_mm = d.sorted_mm;
  for (float& v : d.magnitudes_mm) v = std::abs(v);
  std::sort(d.magnitudes_mm.begin(), d.magnitudes_mm.end());
  d.all = {result.statistics.mean, result.statistics.sigma};
  if (!d.sorted_mm.empty()) {
    const auto middle = static_cast<std::ptrdiff_t>(d.sorted_mm.size() / 2);
    d.bulk.mean_mm = d.sorted_mm[middle];
    std::vector<float> off(d.sorted_mm);
    for (float& v : off) v = std::abs(v - d.sorted_mm[middle]);
    std::nth_element(off.begin(), off.begin() + middle, off.end());
    d.bulk.sigma_mm = 1.4826 * off[middle];
  }
  d.weibull = fit_weibull(d.magnitudes_mm);
  d.all_misfit = misfit(d.sorted_mm, d.all);
  d.bulk_misfit = misfit(d.sorted_mm, d.bulk);
  d.weibull_misfit = d.weibull ? misfit<Weibull>(d.magnitudes_mm, *d.weibull) : kNaN;
  d.magnitude_p50_mm = percentile(d.magnitudes_mm, 50);
  d.magnitude_p95_mm = percentile(d.magnitudes_mm, 95);
  d.magnitude_p99_mm = percentile(d.magnitudes_mm, 99);
  return d;
}

}  // namespace gantry::report
