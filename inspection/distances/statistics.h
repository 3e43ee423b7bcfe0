#pragma once

#include <span>
#include <vector>

#include "gantry/inspection/distances.h"

namespace gantry::internal {

/// Sorted, without those that are NaN.
std::vector<float> sorted_finite(std::span<const float> values);

/// Of sorted values, at least one; `percent` from 0 to 100. Between two values linearly interpolated (R's
/// type 7, NumPy's default).
double percentile(std::span<const float> sorted, double percent);

DistanceSummary summary_of(std::span<const float> values);

}  // namespace gantry::internal
