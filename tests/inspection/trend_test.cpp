#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "foundation/expect_input_error.h"
#include "gantry/inspection/series.h"
#include "inspection/series_samples.h"
#include "series/capability.h"
#include "series/control_rules.h"

namespace gantry {
namespace {

ControlChart chart_of(const std::vector<double>& means_mm, const TrendOptions& options = {}) {
  return analyse_trend(series_of(means_mm), options).faces.at(0);
}

TEST(Trend, LimitsOfIndividualsAndMovingRanges) {
  // By hand: mean 3, moving ranges 1 3 1 3 2, their mean 2.
  const ControlChart c = chart_of({2, 3, 6, 5, 2, 0});
  EXPECT_DOUBLE_EQ(c.centre_mm, 3);
  EXPECT_DOUBLE_EQ(c.range_mean_mm, 2.0);
  EXPECT_NEAR(c.upper_mm, 3 + 2.66 * 2.0, 1e-3);
  EXPECT_NEAR(c.lower_mm, 3 - 2.66 * 2.0, 1e-3);
  EXPECT_NEAR(c.range_upper_mm, 3.267 * 2.0, 1e-9);
  EXPECT_TRUE(std::isnan(c.moving_ranges[0]));
  EXPECT_DOUBLE_EQ(c.moving_ranges[2], 3);
}

/// Montgomery, "Introduction to Statistical Quality Control", example 6.5: costs of processing loan
/// applications.
TEST(Trend, MontgomerysLoans) {
  const ControlChart c = chart_of(
      {310, 288, 297, 298, 307, 303, 294, 297, 308, 306, 294, 299, 297, 299, 314, 295, 293, 306, 301, 304});
  EXPECT_NEAR(c.centre_mm, 300.5, 0.01);
  EXPECT_NEAR(c.range_mean_mm, 7.79, 0.005);
  EXPECT_NEAR(c.upper_mm, 321.22, 0.02);
  EXPECT_NEAR(c.lower_mm, 279.78, 0.02);
  EXPECT_NEAR(c.range_upper_mm, 25.45, 0.02);
  EXPECT_TRUE(c.in_control());
}

TEST(Trend, ShiftsAndScalesWithTheValues) {
  const std::vector<double> values = normal_values(30, 0.05, 0.01, 4);
  const ControlChart c = chart_of(values);
  std::vector<double> other = values;
  for (double& v : other) v = 3 * v - 0.02;
  const ControlChart d = chart_of(other);
  EXPECT_NEAR(d.sigma_mm, 3 * c.sigma_mm, 1e-12);
  EXPECT_NEAR(d.upper_mm, 3 * c.upper_mm - 0.02, 1e-12);
  EXPECT_EQ(d.signals.size(), c.signals.size());
  EXPECT_NEAR(d.drift.per_run_mm.value, 3 * c.drift.per_run_mm.value, 1e-12);
}

std::vector<std::string> rules_fired(const std::vector<double>& z, ControlRules rules) {
  std::vector<std::string> names;
  for (const ControlSignal& s : series::find_signals(z, rules)) names.push_back(s.rule);
  return names;
}

using Names = std::vector<std::string>;

TEST(ControlRules, WesternElectric) {
  const auto fired = [](const std::vector<double>& z) {
    return rules_fired(z, ControlRules::kWesternElectric);
  };
  EXPECT_EQ(fired({0, 0, 3.1, 0}), Names{"Western Electric 1"});
  EXPECT_EQ(fired({0, 0, 2.9, 0}), Names{});
  EXPECT_EQ(fired({2.1, 0, 2.1}), Names{"Western Electric 2"});
  EXPECT_EQ(fired({2.1, 0, -2.1}), Names{});
  EXPECT_EQ(fired({2.1, 0, 0, 2.1}), Names{});
  EXPECT_EQ(fired({-1.1, -1.2, 0, -1.3, -1.1}), Names{"Western Electric 3"});
  EXPECT_EQ(fired({-1.1, -1.2, 0, -0.9, -1.1}), Names{});
  EXPECT_EQ(fired({.1, .2, .1, .3, .1, .2, .1, .2}), Names{"Western Electric 4"});
  EXPECT_EQ(fired({.1, .2, .1, .3, .1, .2, .1, -.2}), Names{});
  const auto signals = series::find_signals(std::vector<double>(12, 0.5), ControlRules::kWesternElectric);
  ASSERT_EQ(signals.size(), 1u);  // one long run, not five
  EXPECT_EQ(signals[0].first, 0u);
  EXPECT_EQ(signals[0].last, 11u);
}

TEST(ControlRules, Nelson) {
  const auto fired = [](const std::vector<double>& z) { return rules_fired(z, ControlRules::kNelson); };
  EXPECT_EQ(fired({0, -3.1}), Names{"Nelson 1"});
  EXPECT_EQ(fired({.1, .4, .1, .3, .1, .2, .1, .2, .1}), Names{"Nelson 2"});
  EXPECT_EQ(fired({-1, -.5, 0, .2, .5, .9}), Names{"Nelson 3"});
  EXPECT_EQ(fired({-1, -.5, 0, .2, .5, .5}), Names{});
  EXPECT_EQ(fired({.2, 1.1, -.4, 1.2, -1.3, .1, -.8, 1, -.2, .3, -1.1, 1.4, -.1, .2}), Names{"Nelson 4"});
  EXPECT_EQ(fired({2.1, 0, 2.1}), Names{"Nelson 5"});
  EXPECT_EQ(fired({-1.1, -1.2, 0, -1.3, -1.1}), Names{"Nelson 6"});
  EXPECT_EQ(fired({.1, .2, -.3, .1, .1, -.2, .1, .2, -.3, -.4, .1, .2, -.1, -.2, .3}), Names{"Nelson 7"});
  EXPECT_EQ(fired({1.1, -1.2, 1.5, -1.1, -1.4, 1.2, 1.1, -1.6}), Names{"Nelson 8"});
}

/// Average run lengths of steady processes with exact limits (Champ and Woodall, Technometrics 29, 1987):
/// 370.4 for the limits alone, 91.75 for Western Electric's four rules.
TEST(ControlRules, FalseAlarmsComeAsOftenAsPublished) {
  const auto mean_run_length = [](ControlRules rules) {
    std::mt19937_64 random(11);
    std::normal_distribution<double> normal;
    double sum = 0;
    constexpr int kRuns = 400;
    for (int run = 0; run < kRuns; ++run) {
      std::vector<double> z;
      for (size_t length = 100;; length *= 2) {  // until one is found: the first signal does not change
        while (z.size() < length) z.push_back(normal(random));
        size_t first = length;
        for (const ControlSignal& s : series::find_signals(z, rules))
          first = std::min(first, s.first + (s.rule.back() == '4'   ? 7
                                             : s.rule.back() == '3' ? 4
                                             : s.rule.back() == '2' ? 2
                                                                    : 0));
        if (first == length) continue;
        sum += static_cast<double>(first + 1);
        break;
      }
    }
    return sum / kRuns;
  };
  EXPECT_NEAR(mean_run_length(ControlRules::kLimits), 370.4, 3 * 370.4 / 20);
  EXPECT_NEAR(mean_run_length(ControlRules::kWesternElectric), 91.75, 3 * 91.75 / 20);
}

TEST(Trend, AShiftAndADriftAreFound) {
  std::vector<double> values = normal_values(30, 0, 0.01, 5);
  EXPECT_TRUE(chart_of(values, {.rules = ControlRules::kLimits, .baseline = 20}).in_control());
  for (size_t i = 22; i < values.size(); ++i) values[i] += 0.06;
  const ControlChart shifted = chart_of(values, {.rules = ControlRules::kLimits, .baseline = 20});
  ASSERT_FALSE(shifted.in_control());
  EXPECT_EQ(shifted.baseline, 20u);
  EXPECT_EQ(shifted.signals.front().last, 29u);

  values = normal_values(30, 0, 0.01, 6);
  EXPECT_FALSE(chart_of(values).drift.significant);
  for (size_t i = 0; i < values.size(); ++i) values[i] += 0.002 * static_cast<double>(i);
  const Drift drift = chart_of(values).drift;
  EXPECT_TRUE(drift.significant);
  EXPECT_NEAR(drift.per_run_mm.value, 0.002, 0.0006);
  EXPECT_LT(drift.per_run_mm.low, drift.per_run_mm.value);
  EXPECT_NEAR(drift.total_mm, 29 * drift.per_run_mm.value, 1e-12);
}

TEST(Trend, TheDriftsIntervalHoldsTheTruthAsOftenAsItSays) {
  int held = 0;
  for (uint64_t seed = 0; seed < 1000; ++seed) {
    std::vector<double> at, values = normal_values(12, 0, 0.01, seed);
    for (size_t i = 0; i < values.size(); ++i) {
      at.push_back(static_cast<double>(i));
      values[i] += 0.001 * static_cast<double>(i);
    }
    const Estimate slope = series::drift(at, values).per_run_mm;
    held += slope.low <= 0.001 && slope.high >= 0.001;
  }
  EXPECT_NEAR(held, 950, 25);
}

TEST(Trend, CapabilityByHand) {
  // sigma 0.02 overall, mean 0.05, tolerance 0.2.
  std::vector<double> values{0.03, 0.05, 0.07, 0.05, 0.05};
  const Capability c = chart_of(values).capability;
  const double sigma = std::sqrt((2 * 0.02 * 0.02) / 4), within = 0.015 / 1.128;
  EXPECT_NEAR(c.pp.value, 0.2 / (3 * sigma), 1e-9);
  EXPECT_NEAR(c.ppk.value, 0.15 / (3 * sigma), 1e-9);
  EXPECT_NEAR(c.cp.value, 0.2 / (3 * within), 1e-9);
  EXPECT_NEAR(c.cpk.value, 0.15 / (3 * within), 1e-9);
  for (const Estimate& e : {c.cp, c.cpk, c.pp, c.ppk}) {
    EXPECT_LT(e.low, e.value);
    EXPECT_GT(e.high, e.value);
  }
  EXPECT_TRUE(std::isnan(chart_of(values, {.figure = SeriesFigure::kSigma}).capability.cp.value));
  EXPECT_TRUE(std::isnan(chart_of({0.1, 0.1, 0.1}).capability.cp.value));
}

TEST(Trend, CapabilityIntervalsHoldTheTruthAsOftenAsTheySay) {
  std::array<int, 4> held{};
  const double truth_p = 0.2 / 0.06, truth_pk = 0.17 / 0.06;  // sigma 0.02, mean 0.03
  for (uint64_t seed = 0; seed < 1000; ++seed) {
    const std::vector<double> values = normal_values(25, 0.03, 0.02, seed);
    std::vector<double> ranges;
    for (size_t i = 1; i < values.size(); ++i) ranges.push_back(std::abs(values[i] - values[i - 1]));
    const Capability c = series::capability(values, ranges, 0.2);
    const auto count = [&](size_t k, const Estimate& e, double truth) {
      held[k] += e.low <= truth && e.high >= truth;
    };
    count(0, c.pp, truth_p);
    count(1, c.ppk, truth_pk);
    count(2, c.cp, truth_p);
    count(3, c.cpk, truth_pk);
  }
  for (const int k : held) EXPECT_NEAR(k, 950, 25);
}

TEST(Trend, RunsThatDoNotCountEnterNothing) {
  std::vector<double> values = normal_values(12, 0, 0.01, 9);
  Series with = series_of(values);
  SeriesRun doubtful = with.runs[5];
  doubtful.doubt = "UNDECIDED";
  doubtful.faces[0].mean_mm = 9;
  with.runs.insert(with.runs.begin() + 5, doubtful);
  const ControlChart c = analyse_trend(with, {}).faces.at(0), reference = chart_of(values);
  EXPECT_EQ(c.used, 12u);
  EXPECT_EQ(c.values[5], 9);
  EXPECT_TRUE(std::isnan(c.moving_ranges[5]));
  EXPECT_EQ(c.centre_mm, reference.centre_mm);
  EXPECT_EQ(c.sigma_mm, reference.sigma_mm);
  EXPECT_EQ(c.capability.ppk.value, reference.capability.ppk.value);
}

TEST(Trend, AFeatureMissingInSomeRunsIsChartedOverTheOthers) {
  Series series = series_of(normal_values(6, 0, 0.01, 3));
  series.runs[2].faces.clear();
  EXPECT_EQ(analyse_trend(series, {}).faces.at(0).used, 5u);
  for (size_t r = 1; r < 6; ++r) series.runs[r].faces.clear();
  expect_input_error([&] { analyse_trend(series, {}); }, {"no face or region"});
}

TEST(Trend, RefusesWhatMakesNoTrend) {
  Series series = series_of({1, 2, 3});
  expect_input_error([&] { analyse_trend(series, {.baseline = 4}); }, {"baseline", "2 to 3"});
  for (size_t r = 0; r < 2; ++r) series.runs[r].doubt = "UNDECIDED";
  expect_input_error([&] { analyse_trend(series, {}); }, {"at least two runs", "3 given, 1"});
}

TEST(Trend, AValueFarOutIsNoChanceAndSteadyChartsAreNoAlarm) {
  std::vector<double> values = normal_values(20, 0, 0.01, 3);
  int beyond = 0;
  for (uint64_t seed = 0; seed < 200; ++seed)
    beyond += analyse_trend(series_of(normal_values(20, 0, 0.01, 900 + seed)), {}).beyond_chance;
  EXPECT_LE(beyond, 12);
  values[12] += 0.3;
  const Trend trend = analyse_trend(series_of(values), {});
  EXPECT_EQ(trend.signalling, 1u);
  EXPECT_TRUE(trend.beyond_chance);
  EXPECT_EQ(trend.furthest, "plane 1");
  // Runs that agree to the last digit, and then one that does not.
  values.assign(20, 0.01);
  EXPECT_TRUE(analyse_trend(series_of(values), {}).faces[0].in_control());
  values.back() = 0.02;
  EXPECT_FALSE(analyse_trend(series_of(values), {.baseline = 10}).faces[0].in_control());
  EXPECT_TRUE(analyse_trend(series_of(values), {.baseline = 10}).beyond_chance);
}

TEST(Trend, ChanceSignalsAreCountedAsTheyCome) {
  // Steady charts: as many signal as it says.
  const TrendOptions options;
  int signalling = 0;
  for (uint64_t seed = 0; seed < 500; ++seed)
    signalling +=
        !chart_of(normal_values(15, 0, 1, 7000 + seed), {.rules = ControlRules::kLimits}).in_control();
  const double expected = 500 * series::false_signal_probability(15, {.rules = ControlRules::kLimits});
  EXPECT_NEAR(signalling, expected, 3.5 * std::sqrt(expected) + 1);
  EXPECT_GT(series::false_signal_probability(15, options), expected / 500);
}

}  // namespace
}  // namespace gantry
