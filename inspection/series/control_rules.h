#pragma once

#include <vector>

#include "gantry/inspection/series.h"

namespace gantry::series {

/// The signals in a row of values, given as multiples of sigma from the centre line; `first` and `last` are
/// indices into `z`. Overlapping occurrences of one rule are joined.
std::vector<ControlSignal> find_signals(const std::vector<double>& z, ControlRules rules);

/// Centre, limits and signals of one chart whose values at `runs` count (indices, rising). Also what
/// find_signals() is given for simulated charts: see false_signal_probability().
void set_limits(ControlChart& chart, const std::vector<size_t>& runs, const TrendOptions& options);

/// The probability that the chart of a steady process, of so many normal and independent values, shows a
/// signal: simulated with a fixed seed, limits estimated as set_limits() does.
double false_signal_probability(size_t used, const TrendOptions& options);

}  // namespace gantry::series
