#include "series/control_rules.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <span>

namespace gantry::series {
namespace {

// For moving ranges of two (Montgomery, appendix VI).
constexpr double kD2 = 1.128, kD4 = 3.267;

using Window = std::span<const double>;

/// `wanted` values of the window, the last one among them, beyond `sigmas` on the side `sign`.
bool beyond(Window z, double sigmas, size_t wanted, double sign) {
  const auto is_beyond = [&](double v) { return sign * v > sigmas; };
  return is_beyond(z.back()) && static_cast<size_t>(std::count_if(z.begin(), z.end(), is_beyond)) >= wanted;
}

bool all_on_side(Window z, double sign) {
  return std::all_of(z.begin(), z.end(), [&](double v) { return sign * v > 0; });
}

bool steadily(Window z, double sign) {
  for (size_t i = 1; i < z.size(); ++i)
    if (!(sign * (z[i] - z[i - 1]) > 0)) return false;
  return true;
}

bool alternating(Window z) {
  for (size_t i = 2; i < z.size(); ++i)
    if (!((z[i] - z[i - 1]) * (z[i - 1] - z[i - 2]) < 0)) return false;
  return true;
}

bool all_within(Window z, double sigmas) {
  return std::all_of(z.begin(), z.end(), [&](double v) { return std::abs(v) < sigmas; });
}

struct Rule {
  const char *name, *words;
  size_t window;
  std::function<bool(Window)> fires;
};

/// A rule for each side.
void add_both(std::vector<Rule>& rules, const char* name, const char* up, const char* down, size_t window,
              const std::function<bool(Window, double)>& fires) {
  rules.push_back({name, up, window, [=](Window z) { return fires(z, 1); }});
  rules.push_back({name, down, window, [=](Window z) { return fires(z, -1); }});
}

std::vector<Rule> rules_of(ControlRules set) {
  std::vector<Rule> rules;
  const bool nelson = set == ControlRules::kNelson;
  add_both(rules, nelson ? "Nelson 1" : "Western Electric 1", "above the upper limit",
           "below the lower limit", 1, [](Window z, double s) { return beyond(z, 3, 1, s); });
  if (set == ControlRules::kLimits) return rules;
  add_both(rules, nelson ? "Nelson 5" : "Western Electric 2", "2 of 3 more than two sigma above",
           "2 of 3 more than two sigma below", 3, [](Window z, double s) { return beyond(z, 2, 2, s); });
  add_both(rules, nelson ? "Nelson 6" : "Western Electric 3", "4 of 5 more than one sigma above",
           "4 of 5 more than one sigma below", 5, [](Window z, double s) { return beyond(z, 1, 4, s); });
  if (!nelson) {
    add_both(rules, "Western Electric 4", "8 in a row above the centre", "8 in a row below the centre", 8,
             all_on_side);
    return rules;
  }
  add_both(rules, "Nelson 2", "9 in a row above the centre", "9 in a row below the centre", 9, all_on_side);
  add_both(rules, "Nelson 3", "6 in a row rising", "6 in a row falling", 6, steadily);
  rules.push_back({"Nelson 4", "14 in a row up and down by turns", 14, alternating});
  rules.push_back(
      {"Nelson 7", "15 in a row within one sigma", 15, [](Window z) { return all_within(z, 1); }});
  rules.push_back({"Nelson 8", "8 in a row, none within one sigma", 8, [](Window z) {
                     return std::none_of(z.begin(), z.end(), [](double v) { return std::abs(v) <= 1; });
                   }});
  return rules;
}

std::vector<ControlSignal> find_signals(const std::vector<double>& z, const std::vector<Rule>& rules) {
  std::vector<ControlSignal> signals;
  for (const Rule& rule : rules) {
    bool before = false;
    for (size_t end = rule.window; end <= z.size(); ++end) {
      const bool fires = rule.fires(Window(z).subspan(end - rule.window, rule.window));
      if (fires && before) {
        signals.back().last = end - 1;
      } else if (fires) {
        signals.push_back({end - rule.window, end - 1, rule.name, rule.words});
      }
      before = fires;
    }
  }
  return signals;
}

}  // namespace

std::vector<ControlSignal> find_signals(const std::vector<double>& z, ControlRules rules) {
  return find_signals(z, rules_of(rules));
}

void set_limits(ControlChart& chart, const std::vector<size_t>& runs, const TrendOptions& options) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const size_t n = runs.size();
  chart.used = n;
  chart.baseline = options.baseline > 0 ? std::min(options.baseline, n) : n;
  chart.moving_ranges.assign(chart.values.size(), kNaN);
  for (size_t i = 1; i < n; ++i)
    chart.moving_ranges[runs[i]] = std::abs(chart.values[runs[i]] - chart.values[runs[i - 1]]);
  // From the first value on: the mean of equal values is that value, to the last digit.
  const double first = chart.values[runs[0]];
  double sum = 0, ranges = 0;
  for (size_t i = 0; i < chart.baseline; ++i) {
    sum += chart.values[runs[i]] - first;
    if (i > 0) ranges += chart.moving_ranges[runs[i]];
  }
  chart.centre_mm = first + sum / static_cast<double>(chart.baseline);
  chart.range_mean_mm = ranges / static_cast<double>(chart.baseline - 1);
  chart.sigma_mm = chart.range_mean_mm / kD2;
  chart.lower_mm = chart.centre_mm - 3 * chart.sigma_mm;
  chart.upper_mm = chart.centre_mm + 3 * chart.sigma_mm;
  chart.range_upper_mm = kD4 * chart.range_mean_mm;

  std::vector<double> z(n);
  for (size_t i = 0; i < n; ++i) {
    const double off = chart.values[runs[i]] - chart.centre_mm;
    // Of runs that agree to the last digit anything else is out of control.
    z[i] = chart.sigma_mm > 0 ? off / chart.sigma_mm : off == 0 ? 0 : std::copysign(1e9, off);
  }
  chart.signals = find_signals(z, options.rules);
  if (!(chart.sigma_mm > 0))
    std::erase_if(chart.signals, [](const ControlSignal& s) { return s.rule == "Nelson 7"; });
  for (size_t i = 1; i < n; ++i)
    if (chart.moving_ranges[runs[i]] > chart.range_upper_mm)
      chart.signals.push_back({i - 1, i, "Moving range", "a jump beyond the limit of the moving ranges"});
  for (ControlSignal& signal : chart.signals) {
    signal.first = runs[signal.first];
    signal.last = runs[signal.last];
  }
}

double false_signal_probability(size_t used, const TrendOptions& options) {
  constexpr size_t kCharts = 2000;
  std::mt19937_64 random(20'240'613);
  std::normal_distribution<double> normal;
  std::vector<size_t> runs(used);
  for (size_t i = 0; i < used; ++i) runs[i] = i;
  size_t signalling = 0;
  for (size_t k = 0; k < kCharts; ++k) {
    ControlChart chart;
    for (size_t i = 0; i < used; ++i) chart.values.push_back(normal(random));
    set_limits(chart, runs, options);
    signalling += !chart.in_control();
  }
  return static_cast<double>(signalling) / kCharts;
}

}  // namespace gantry::series
