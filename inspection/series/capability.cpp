#include "series/capability.h"

#include <cmath>

#include "series/probability.h"

namespace gantry::series {
namespace {

constexpr double kNormal975 = 1.959963984540054;
constexpr double kD2 = 1.128;

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

/// Width of the tolerance over that of the process.
Estimate width_ratio(double tolerance_mm, double sigma_mm, double freedoms) {
  const double value = tolerance_mm / (3 * sigma_mm);
  return {value, value * std::sqrt(chi_square_quantile(0.025, freedoms) / freedoms),
          value * std::sqrt(chi_square_quantile(0.975, freedoms) / freedoms)};
}

/// The same on the side that is nearer.
Estimate nearer_side(double tolerance_mm, double mean_mm, double sigma_mm, double n, double freedoms) {
  const double value = (tolerance_mm - std::abs(mean_mm)) / (3 * sigma_mm);
  const double half = kNormal975 * std::sqrt(1 / (9 * n) + value * value / (2 * freedoms));
  return {value, value - half, value + half};
}

}  // namespace

Capability capability(const std::vector<double>& values, const std::vector<double>& ranges,
                      double tolerance_mm) {
  Capability result;
  if (values.size() < 3) return result;
  const double n = static_cast<double>(values.size()), mean = mean_of(values);
  double squares = 0;
  for (const double v : values) squares += (v - mean) * (v - mean);
  const double overall = std::sqrt(squares / (n - 1)), within = mean_of(ranges) / kD2;
  if (within > 0) {
    const double freedoms = kRangeFreedoms * (n - 1);
    result.cp = width_ratio(tolerance_mm, within, freedoms);
    result.cpk = nearer_side(tolerance_mm, mean, within, n, freedoms);
  }
  if (overall > 0) {
    result.pp = width_ratio(tolerance_mm, overall, n - 1);
    result.ppk = nearer_side(tolerance_mm, mean, overall, n, n - 1);
  }
  return result;
}

Drift drift(const std::vector<double>& at, const std::vector<double>& values) {
  Drift result;
  if (values.size() < 3) return result;
  const double n = static_cast<double>(values.size()), middle = mean_of(at), mean = mean_of(values);
  double xx = 0, xy = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    xx += (at[i] - middle) * (at[i] - middle);
    xy += (at[i] - middle) * (values[i] - mean);
  }
  const double slope = xy / xx;
  double squares = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    const double off = values[i] - mean - slope * (at[i] - middle);
    squares += off * off;
  }
  const double half = student_quantile(0.975, n - 2) * std::sqrt(squares / (n - 2) / xx);
  result.per_run_mm = {slope, slope - half, slope + half};
  result.total_mm = slope * (at.back() - at.front());
  result.significant = result.per_run_mm.low > 0 || result.per_run_mm.high < 0;
  return result;
}

}  // namespace gantry::series
