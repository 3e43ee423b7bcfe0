#pragma once

#include <optional>
#include <span>

namespace gantry::bench {

struct Trial {
  double depth_mm = 0;
  bool found = false;
};

/// Probability of detection against depth: logistic in log depth, as MIL-HDBK-1823A has it for hit/miss data.
/// Fitted by Firth's penalised likelihood ("Bias reduction of maximum likelihood estimates", 1993), which
/// exists also when every deep dent was found and every shallow one missed.
struct DetectionCurve {
  double middle = 0, slope = 0;  ///< logit(p) = slope (ln depth - middle)
  double a50_mm = 0, a90_mm = 0;
  double a90_95_mm = 0;  ///< With 95 % confidence a90 is not larger (delta method on ln a90).

  double probability(double depth_mm) const;
};

/// Nothing when fewer than ten trials, or hits or misses only, or when depth does not help.
std::optional<DetectionCurve> fit_detection(std::span<const Trial> trials);

}  // namespace gantry::bench
