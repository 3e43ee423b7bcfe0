#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

namespace gantry {

/// The register value nearest to value * counts_per_unit, or nothing when it does not fit.
inline std::optional<int32_t> to_counts(double value, double counts_per_unit) {
  const double counts = std::round(value * counts_per_unit);
  if (!(std::abs(counts) <= std::numeric_limits<int32_t>::max())) return std::nullopt;
  return static_cast<int32_t>(counts);
}

/// The same for a speed or an acceleration, of which at least one count is needed to move at all.
inline std::optional<int32_t> to_rate_counts(double value, double counts_per_unit, int32_t maximum) {
  const auto counts = to_counts(value, counts_per_unit);
  if (!counts || *counts > maximum || !(value > 0)) return std::nullopt;
  return *counts < 1 ? 1 : *counts;
}

}  // namespace gantry
