#include "distances/statistics.h"

#include <algorithm>
#include <cmath>

namespace gantry::internal {

std::vector<float> sorted_finite(std::span<const float> values) {
  std::vector<float> sorted;
  sorted.reserve(values.size());
  for (const float v : values)
    if (std::isfinite(v)) sorted.push_back(v);
  std::sort(sorted.begin(), sorted.end());
  return sorted;
}

double percentile(std::span<const float> sorted, double percent) {
  const double at = percent / 100 * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<size_t>(at);
  const size_t above = std::min(below + 1, sorted.size() - 1);
  return std::lerp(static_cast<double>(sorted[below]), static_cast<double>(sorted[above]),
                   at - static_cast<double>(below));
}

DistanceSummary summary_of(std::span<const float> values) {
  const std::vector<float> sorted = sorted_finite(values);
  DistanceSummary s;
  s.count = sorted.size();
  if (sorted.empty()) return s;
  const auto n = static_cast<double>(s.count);
  double sum = 0, squares = 0, scatter = 0;
  for (const double v : sorted) {
    sum += v;
    squares += v * v;
  }
  s.mean = sum / n;
  s.rms = std::sqrt(squares / n);
  for (const double v : sorted) scatter += (v - s.mean) * (v - s.mean);
  s.sigma = std::sqrt(scatter / n);
  s.min = sorted.front();
  s.max = sorted.back();
  s.p05 = percentile(sorted, 5);
  s.p50 = percentile(sorted, 50);
  s.p95 = percentile(sorted, 95);
  return s;
}

}  // namespace gantry::internal
