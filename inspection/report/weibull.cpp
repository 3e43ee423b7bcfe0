#include "report/weibull.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace gantry::report {

double Weibull::density(double mm) const {
  if (mm <= 0) return 0;
  const double power = std::pow(mm / scale_mm, shape);
  return shape / mm * power * std::exp(-power);
}

double Weibull::probability(double mm) const {
  return mm > 0 ? -std::expm1(-std::pow(mm / scale_mm, shape)) : 0.0;
}

std::optional<Weibull> fit_weibull(std::span<const float> values_mm) {
  std::vector<double> logs;
  logs.reserve(values_mm.size());
  double largest = -1e300, sum = 0;
  for (const float v : values_mm) {
    if (!(v > 0) || !std::isfinite(v)) continue;
    logs.push_back(std::log(static_cast<double>(v)));
    largest = std::max(largest, logs.back());
    sum += logs.back();
  }
  if (logs.size() < 10) return std::nullopt;
  const auto n = static_cast<double>(logs.size());
  double squares = 0;
  for (double& l : logs) squares += (l - sum / n) * (l - sum / n);
  const double spread = std::sqrt(squares / n);
  if (!(spread > 1e-7)) return std::nullopt;
  for (double& l : logs) l -= largest;  // no power overflows, and the largest value counts fully
  const double mean = sum / n - largest;

  double low = 0, high = 1e300,
         k = std::numbers::pi / std::sqrt(6.0) / spread;  // where log x has this spread
  double power_sum = 0;
  for (int i = 0; i < 100; ++i) {
    double first = 0, second = 0;
    power_sum = 0;
    for (const double l : logs) {
      const double power = std::exp(k * l);
      power_sum += power;
      first += power * l;
      second += power * l * l;
    }
    const double weighted = first / power_sum;
    const double value = weighted - 1 / k - mean;
    const double slope = second / power_sum - weighted * weighted + 1 / (k * k);
    (value > 0 ? high : low) = k;
    double next = k - value / slope;
    if (!(next > low && next < high)) next = high < 1e299 ? 0.5 * (low + high) : 2 * k;
    const double step = std::abs(next - k);
    k = next;
    if (step <= 1e-10 * k) break;
  }
  power_sum = 0;
  for (const double l : logs) power_sum += std::exp(k * l);
  return Weibull{k, std::exp(largest + std::log(power_sum / n) / k)};
}

}  // namespace gantry::report
