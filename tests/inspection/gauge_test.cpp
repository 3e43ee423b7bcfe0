#include "gantry/inspection/gauge.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"
#include "inspection/series_samples.h"

namespace gantry {
namespace {

/// AIAG, "Measurement Systems Analysis", 4th edition, figure III-B 15: ten parts, three appraisers, three
/// trials.
GaugeTable aiag() {
  const double data[3][3][10] = {{{0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36},
                                  {0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25},
                                  {0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31}},
                                 {{0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68},
                                  {0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62},
                                  {0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50}},
                                 {{0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49},
                                  {-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77},
                                  {-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16}}};
  GaugeTable table;
  for (int p = 0; p < 10; ++p) table.parts.push_back(std::to_string(p + 1));
  table.appraisers = {"A", "B", "C"};
  table.trials = 3;
  for (int p = 0; p < 10; ++p)
    for (int a = 0; a < 3; ++a)
      for (int t = 0; t < 3; ++t) table.values.push_back(data[a][t][p]);
  return table;
}

TEST(Gauge, AiagsExample) {
  const GaugeResult r = analyse_gauge(aiag(), 2);
  EXPECT_NEAR(r.part.squares, 88.3619, 1e-4);
  EXPECT_NEAR(r.appraiser.squares, 3.1673, 1e-4);
  EXPECT_NEAR(r.interaction.squares, 0.3590, 1e-4);
  EXPECT_NEAR(r.repeatability.squares, 2.7589, 1e-4);
  EXPECT_NEAR(r.total.squares, 94.6471, 1e-4);
  EXPECT_EQ(r.part.freedoms, 9u);
  EXPECT_EQ(r.appraiser.freedoms, 2u);
  EXPECT_EQ(r.interaction.freedoms, 18u);
  EXPECT_EQ(r.repeatability.freedoms, 60u);
  EXPECT_EQ(r.total.freedoms, 89u);
  EXPECT_NEAR(r.part.mean_square, 9.81799, 1e-5);
  EXPECT_NEAR(r.appraiser.mean_square, 1.58363, 1e-5);
  EXPECT_TRUE(r.pooled);
  EXPECT_NEAR(r.interaction_p, 0.974, 1e-3);
  EXPECT_NEAR(r.ev_mm.value, 0.199933, 1e-6);
  EXPECT_NEAR(r.av_mm.value, 0.226838, 1e-6);
  EXPECT_NEAR(r.grr_mm.value, 0.302373, 2e-6);
  EXPECT_NEAR(r.pv_mm.value, 1.042327, 1e-6);
  EXPECT_NEAR(r.tv_mm, 1.0853, 1e-4);
  EXPECT_NEAR(r.percent_study.value, 27.86, 0.01);
  EXPECT_NEAR(r.percent_tolerance.value, 100 * 6 * 0.302373 / 4, 1e-3);
  EXPECT_EQ(r.ndc.value, 4);
  EXPECT_EQ(gauge_words(r.percent_study.value), "conditional");
  EXPECT_LT(r.percent_study.low, 27.86);
  EXPECT_GT(r.percent_study.high, 27.86);
}

/// Measurements of known standard deviations.
GaugeTable drawn(size_t parts, size_t appraisers, size_t trials, double pv, double av, double interaction,
                 double ev, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  GaugeTable table;
  table.trials = trials;
  std::vector<double> of_appraiser(appraisers);
  for (double& v : of_appraiser) v = av * normal(random);
  for (size_t a = 0; a < appraisers; ++a) table.appraisers.push_back("cell " + std::to_string(a));
  for (size_t p = 0; p < parts; ++p) {
    table.parts.push_back(std::to_string(p));
    const double of_part = pv * normal(random);
    for (size_t a = 0; a < appraisers; ++a) {
      const double together = of_part + of_appraiser[a] + interaction * normal(random);
      for (size_t t = 0; t < trials; ++t) table.values.push_back(together + ev * normal(random));
    }
  }
  return table;
}

TEST(Gauge, FindsTheVariancesThatWentIn) {
  double ev = 0, av = 0, pv = 0;
  constexpr int kStudies = 300;
  for (uint64_t seed = 0; seed < kStudies; ++seed) {
    const GaugeResult r = analyse_gauge(drawn(10, 4, 3, 0.05, 0.02, 0.015, 0.01, seed), 0.2);
    ev += r.ev_mm.value * r.ev_mm.value / kStudies;
    av += r.av_mm.value * r.av_mm.value / kStudies;
    pv += r.pv_mm.value * r.pv_mm.value / kStudies;
  }
  EXPECT_NEAR(std::sqrt(ev), 0.01, 0.0005);
  EXPECT_NEAR(std::sqrt(av), std::hypot(0.02, 0.015), 0.002);
  EXPECT_NEAR(std::sqrt(pv), 0.05, 0.002);
}

TEST(Gauge, IntervalsHoldTheTruthAsOftenAsTheySay) {
  int grr = 0, ev = 0, tolerance = 0, study = 0;
  const double truth = std::sqrt(0.02 * 0.02 + 0.015 * 0.015 + 0.01 * 0.01);
  constexpr int kStudies = 200;
  for (uint64_t seed = 0; seed < kStudies; ++seed) {
    const GaugeResult r = analyse_gauge(drawn(10, 4, 3, 0.05, 0.02, 0.015, 0.01, 500 + seed), 0.2);
    const auto holds = [](const Estimate& e, double v) { return e.low <= v && v <= e.high; };
    grr += holds(r.grr_mm, truth);
    ev += holds(r.ev_mm, 0.01);
    tolerance += holds(r.percent_tolerance, 100 * 6 * truth / 0.4);
    study += holds(r.percent_study, 100 * truth / std::hypot(truth, 0.05));
  }
  // Three standard deviations of counting; generalised intervals may hold it a little oftener.
  for (const int held : {grr, ev, tolerance, study}) EXPECT_GE(held, 180);
  EXPECT_EQ(grr, tolerance);
  EXPECT_LE(ev, 199);
}

TEST(Gauge, ScalesWithTheValuesAndIgnoresTheirPlace) {
  GaugeTable table = aiag();
  const GaugeResult r = analyse_gauge(table, 2);
  for (double& v : table.values) v = 0.01 * v + 7;
  const GaugeResult s = analyse_gauge(table, 0.02);
  EXPECT_NEAR(s.grr_mm.value, 0.01 * r.grr_mm.value, 1e-9);
  EXPECT_NEAR(s.percent_study.value, r.percent_study.value, 1e-6);
  EXPECT_NEAR(s.percent_tolerance.value, r.percent_tolerance.value, 1e-6);
  EXPECT_EQ(s.ndc.value, r.ndc.value);
  EXPECT_NEAR(s.percent_study.high, r.percent_study.high, 1e-4);
}

TEST(Gauge, AnInteractionIsKeptWhereItIsReal) {
  const GaugeResult r = analyse_gauge(drawn(10, 3, 3, 0.05, 0.01, 0.04, 0.005, 3), 0.2);
  EXPECT_FALSE(r.pooled);
  EXPECT_LT(r.interaction_p, 1e-6);
  EXPECT_GT(r.av_mm.value, 0.03);
}

TEST(Gauge, WithoutAnyRepeatabilityTheGaugeIsPerfect) {
  GaugeTable table = drawn(5, 1, 3, 0.05, 0, 0, 0, 3);
  const GaugeResult r = analyse_gauge(table, 0.2);
  EXPECT_NEAR(r.ev_mm.value, 0, 1e-12);
  EXPECT_NEAR(r.percent_study.value, 0, 1e-6);
  EXPECT_GE(r.ndc.value, 99);
  EXPECT_EQ(gauge_words(r.percent_tolerance.value), "acceptable");
  for (double& v : table.values) v = 0.1;  // not even parts that differ
  const GaugeResult flat = analyse_gauge(table, 0.2);
  EXPECT_TRUE(std::isnan(flat.ndc.value) || flat.ndc.value >= 0);
  EXPECT_NEAR(flat.percent_tolerance.value, 0, 1e-9);
}

TEST(Gauge, OneAppraiserOrOnePartTellLess) {
  const GaugeResult one = analyse_gauge(drawn(8, 1, 4, 0.05, 0, 0, 0.01, 3), 0.2);
  EXPECT_TRUE(std::isnan(one.av_mm.value));
  EXPECT_EQ(one.grr_mm.value, one.ev_mm.value);
  EXPECT_GT(one.ndc.value, 3);
  const GaugeResult part = analyse_gauge(drawn(1, 3, 10, 0, 0.02, 0, 0.01, 4), 0.2);
  EXPECT_TRUE(std::isnan(part.percent_study.value));
  EXPECT_TRUE(std::isnan(part.ndc.value));
  EXPECT_GT(part.grr_mm.value, part.ev_mm.value);
  EXPECT_GT(part.percent_tolerance.value, 0);
}

TEST(Gauge, Words) {
  EXPECT_EQ(gauge_words(9.99), "acceptable");
  EXPECT_EQ(gauge_words(10), "conditional");
  EXPECT_EQ(gauge_words(30), "conditional");
  EXPECT_EQ(gauge_words(30.1), "not acceptable");
  EXPECT_EQ(gauge_words(NAN), "");
}

TEST(Gauge, RefusesTablesThatTellNothing) {
  GaugeTable table = aiag();
  table.values.pop_back();
  expect_input_error([&] { analyse_gauge(table, 2); }, {"not complete"});
  table = aiag();
  table.values[3] = NAN;
  expect_input_error([&] { analyse_gauge(table, 2); }, {"finite"});
  expect_input_error([&] { analyse_gauge(drawn(4, 2, 1, 1, 1, 1, 1, 1), 2); }, {"at least twice"});
  expect_input_error([&] { analyse_gauge(aiag(), 0); }, {"tolerance"});
}

class GaugeStudyFile : public ::testing::Test {
 protected:
  GaugeStudy study(const std::string& text) { return read_gauge_study(folder_.write("GAUGE.yaml", text)); }
  void refused(const std::string& text, const std::vector<std::string>& parts) {
    expect_input_error([&] { study(text); }, parts);
  }
  TemporaryFolder folder_;
};

TEST_F(GaugeStudyFile, IsReadStrictly) {
  const GaugeStudy s = study(
      "name: bracket\nruns:\n  - { run: a1, part: A, appraiser: cell 1 }\n  - { run: /b, part: B, appraiser: "
      "cell 1 }\n");
  EXPECT_EQ(s.name, "bracket");
  ASSERT_EQ(s.trials.size(), 2u);
  EXPECT_EQ(s.trials[0].run, folder_ / "a1");
  EXPECT_EQ(s.trials[1].run, "/b");
  EXPECT_EQ(s.trials[1].appraiser, "cell 1");
  EXPECT_EQ(study("runs: [ { run: a, part: A }, { run: b, part: A } ]\n").name, "GAUGE");
  refused("runs: []\n", {"GAUGE.yaml:1", "runs"});
  refused("runs:\n  - { run: a, part: A }\n", {"runs"});
  refused("runs:\n  - { run: a, part: A }\n  - { run: a, part: B }\n", {"GAUGE.yaml:3", "listed twice"});
  refused("runs:\n  - { run: a, part: A }\n  - { run: b }\n", {"GAUGE.yaml:3", "part"});
  refused("runs:\n  - { run: a, part: A }\n  - { run: b, part: A, cell: x }\n", {"GAUGE.yaml:3", "cell"});
  refused("runs:\n  - { run: a, part: A }\n  - { run: b, part: A, appraiser: x }\n", {"appraiser"});
  refused("parts: 3\n", {"GAUGE.yaml"});
  expect_input_error([&] { read_gauge_study(folder_ / "none.yaml"); }, {"none.yaml"});
}

TEST(GaugeStudy, IsAnalysedForEveryFeatureThatAllRunsHaveSeen) {
  const GaugeTable table = drawn(3, 2, 2, 0.05, 0.01, 0, 0.005, 8);
  GaugeStudy study{"s", {}};
  Series series = series_of(table.values);
  // In any order: trials first.
  std::vector<SeriesRun> runs;
  for (size_t t = 0; t < 2; ++t)
    for (size_t p = 0; p < 3; ++p)
      for (size_t a = 0; a < 2; ++a) {
        const size_t at = (p * 2 + a) * 2 + t;
        runs.push_back(series.runs[at]);
        study.trials.push_back({runs.back().report, table.parts[p], table.appraisers[a]});
      }
  SeriesFeature rare = runs[0].faces[0];
  rare.name = "hole";
  runs[0].faces.push_back(rare);
  const GaugeReport report = analyse_gauge_study(study, runs);
  ASSERT_EQ(report.faces.size(), 1u);
  EXPECT_EQ(report.faces[0].values, table.values);
  EXPECT_NEAR(report.faces[0].grr_mm.value, analyse_gauge(table, 0.2).grr_mm.value, 1e-12);
  EXPECT_EQ(report.unseen, std::vector<std::string>{"hole"});

  GaugeStudy uneven = study;
  uneven.trials[3].part = "2";
  expect_input_error([&] { analyse_gauge_study(uneven, runs); }, {"equally often", "appraiser"});
  runs[4].doubt = "UNDECIDED: too little was seen";
  expect_input_error([&] { analyse_gauge_study(study, runs); },
                     {"counts for nothing", "too little was seen"});
  runs[4].doubt.clear();
  runs[4].cad_sha256 = "other";
  expect_input_error([&] { analyse_gauge_study(study, runs); }, {"another CAD model"});
}

}  // namespace
}  // namespace gantry
