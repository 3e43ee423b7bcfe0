#pragma once

#include <optional>
#include <vector>

#include "gantry/inspection/inspection.h"
#include "report/weibull.h"

namespace gantry::report {

struct Gaussian {
  double mean_mm = 0, sigma_mm = 0;

  double probability(double mm) const;
};

/// How the judged deviations are distributed: sorted values and what describes them.
struct Distribution {
  std::vector<float> sorted_mm;
  std::vector<float> magnitudes_mm;  ///< Sorted.
  Gaussian all;                      ///< Mean and sigma of all judged points.
  Gaussian bulk;                   ///< Median and scaled MAD: of the good surface, which defects hardly move.
  std::optional<Weibull> weibull;  ///< Of the magnitudes, all judged points.
  /// Kolmogorov and Smirnov: the largest difference between the share of points below a value and what the
  /// fit says; 0 is perfect, and NaN where there is nothing to compare.
  double all_misfit, bulk_misfit, weibull_misfit;
  double magnitude_p50_mm, magnitude_p95_mm, magnitude_p99_mm;  ///< NaN without points.
};

Distribution distribution(const InspectionResult& result);

}  // namespace gantry::report
