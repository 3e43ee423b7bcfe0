#pragma once

#include <optional>
#include <span>

namespace gantry::report {

/// P(X <= x) = 1 - exp(-(x / scale)^shape), x >= 0. Shape 1 is exponential, 2 Rayleigh; the magnitudes of
/// Gaussian deviations about zero come near 1.2.
struct Weibull {
  double shape = 1;
  double scale_mm = 1;

  double density(double mm) const;  ///< 1/mm
  double probability(double mm) const;
};

/// Maximum likelihood: the shape k that solves sum(x^k ln x) / sum(x^k) - 1 / k = mean(ln x), whose left side
/// rises with k, by Newton's method kept within a bracket; then scale^k = mean(x^k). Values that are not
/// greater than 0 have no likelihood and are left out. Nothing when fewer than ten remain, or all are equal.
std::optional<Weibull> fit_weibull(std::span<const float> values_mm);

}  // namespace gantry::report
