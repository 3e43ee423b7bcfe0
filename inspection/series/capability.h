#pragma once

#include <vector>

#include "gantry/inspection/series.h"

namespace gantry::series {

/// What each moving range of two is worth as an estimate of sigma, in freedoms of chi-square.
inline constexpr double kRangeFreedoms = 0.62;

/// Of values against -tolerance ... +tolerance; `ranges` are their moving ranges. Intervals: Pp by
/// chi-square, Cp by chi-square with 0.62 (n - 1) freedoms (what moving ranges are worth), Ppk and Cpk as
/// Bissell has them (Applied Statistics 39, 1990). All NaN for fewer than three values.
Capability capability(const std::vector<double>& values, const std::vector<double>& ranges,
                      double tolerance_mm);

/// The line through values at the places `at` (numbers of runs).
Drift drift(const std::vector<double>& at, const std::vector<double>& values);

}  // namespace gantry::series
