#include <algorithm>
#include <cmath>
#include <map>

#include "gantry/foundation/error.h"
#include "gantry/inspection/series.h"
#include "series/capability.h"
#include "series/control_rules.h"
#include "series/probability.h"

namespace gantry {
namespace {

using Features = std::vector<SeriesFeature> SeriesRun::*;

/// One chart for each name, in the order in which names first occur.
std::vector<ControlChart> empty_charts(const Series& series, Features features, SeriesFigure figure) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  std::vector<ControlChart> charts;
  std::map<std::string, size_t> places;
  std::map<std::string, std::pair<double, size_t>> variances;
  for (size_t r = 0; r < series.runs.size(); ++r)
    for (const SeriesFeature& feature : series.runs[r].*features) {
      const auto [place, added] = places.try_emplace(feature.name, charts.size());
      if (added) {
        charts.emplace_back();
        charts.back().name = feature.name;
        charts.back().values.assign(series.runs.size(), kNaN);
      }
      ControlChart& chart = charts[place->second];
      chart.words = feature.words;
      chart.values[r] = value_of(feature, figure);
      if (std::isfinite(feature.uncertainty_mm)) {
        auto& [sum, count] = variances[feature.name];
        sum += feature.uncertainty_mm * feature.uncertainty_mm;
        ++count;
      }
    }
  for (ControlChart& chart : charts) {
    const auto& [sum, count] = variances[chart.name];
    chart.uncertainty_mm = count > 0 ? std::sqrt(sum / static_cast<double>(count)) : kNaN;
  }
  return charts;
}

void finish(ControlChart& chart, const std::vector<size_t>& runs, const TrendOptions& options,
            double tolerance_mm) {
  series::set_limits(chart, runs, options);
  std::vector<double> at, values, ranges;
  for (const size_t r : runs) {
    at.push_back(static_cast<double>(r));
    values.push_back(chart.values[r]);
    if (values.size() > 1) ranges.push_back(chart.moving_ranges[r]);
  }
  if (options.figure != SeriesFigure::kSigma)
    chart.capability = series::capability(values, ranges, tolerance_mm);
  chart.drift = series::drift(at, values);
}

/// The probability of so extreme a value as the chart's most extreme: its distance in multiples of a sigma
/// that was itself estimated follows Student's t, nearly.
double extreme_probability(const ControlChart& chart, const Series& series) {
  double furthest = 0;
  for (size_t r = 0; r < chart.values.size(); ++r)
    if (series.runs[r].doubt.empty() && std::isfinite(chart.values[r]))
      furthest = std::max(furthest, std::abs(chart.values[r] - chart.centre_mm));
  if (!(furthest > 0)) return 1;
  const double z = furthest / chart.sigma_mm;  // infinite for runs that agree to the last digit
  return series::fisher_above(z * z, 1, series::kRangeFreedoms * static_cast<double>(chart.baseline - 1));
}

void judge(Trend& trend, const Series& series) {
  double values = 0, least = 1;
  for (const auto* charts : {&trend.faces, &trend.regions})
    for (const ControlChart& chart : *charts) {
      trend.signalling += !chart.in_control();
      values += static_cast<double>(chart.used);
      const double extreme = extreme_probability(chart, series);
      if (extreme < least) least = extreme, trend.furthest = chart.name;
    }
  if (values * least >= 0.01) trend.furthest.clear();
  // So many or more, of a Poisson variable: by chi-square (Abramowitz and Stegun 26.4.21).
  const bool too_many =
      trend.signalling > 0 &&
      series::chi_square_below(2 * trend.expected_false, 2 * static_cast<double>(trend.signalling)) < 0.025;
  trend.beyond_chance = too_many || !trend.furthest.empty();
}

}  // namespace

Trend analyse_trend(const Series& series, const TrendOptions& options) {
  size_t counting = 0;
  double tolerance_mm = 0;
  for (const SeriesRun& run : series.runs) {
    if (!run.doubt.empty()) continue;
    ++counting;
    tolerance_mm = run.tolerance_mm;  // the last one's: what is asked for today
  }
  if (counting < 2)
    throw InputError("a trend needs at least two runs that count; of " + std::to_string(series.runs.size()) +
                     " given, " + std::to_string(counting) + " did");
  if (options.baseline == 1 || options.baseline > counting)
    throw InputError("the baseline must be 2 to " + std::to_string(counting) +
                     " runs, as many as count; found " + std::to_string(options.baseline));
  Trend trend;
  std::map<size_t, double> false_signals;  // by number of values
  for (const auto& [features, charts] :
       {std::pair{&SeriesRun::faces, &trend.faces}, std::pair{&SeriesRun::regions, &trend.regions}})
    for (ControlChart& chart : empty_charts(series, features, options.figure)) {
      std::vector<size_t> runs;
      for (size_t r = 0; r < series.runs.size(); ++r)
        if (series.runs[r].doubt.empty() && std::isfinite(chart.values[r])) runs.push_back(r);
      if (runs.size() < 2) continue;
      finish(chart, runs, options, tolerance_mm);
      if (!false_signals.contains(runs.size()))
        false_signals[runs.size()] = series::false_signal_probability(runs.size(), options);
      trend.expected_false += false_signals[runs.size()];
      charts->push_back(std::move(chart));
    }
  if (trend.faces.empty() && trend.regions.empty())
    throw InputError(
        "no face or region was seen by two of the runs that count: were these reports written by this "
        "version of gantry?");
  judge(trend, series);
  return trend;
}

}  // namespace gantry
