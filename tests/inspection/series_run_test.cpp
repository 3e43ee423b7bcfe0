#include <gtest/gtest.h>

#include <cmath>

#include "foundation/expect_input_error.h"
#include "foundation/temporary_folder.h"
#include "gantry/inspection/gauge.h"
#include "gantry/inspection/series.h"
#include "inspection/series_samples.h"

namespace gantry {
namespace {

class SeriesRunFile : public ::testing::Test {
 protected:
  /// A run folder of that name.
  std::filesystem::path run(const std::string& name, const nlohmann::json& report, bool trusted = true) {
    std::filesystem::create_directories(folder_ / name / "inspection");
    std::filesystem::create_directories(folder_ / name / "registration");
    folder_.write(name + "/inspection/report.json", report.dump());
    folder_.write(name + "/registration/registration.json",
                  nlohmann::json{{"trusted", trusted}, {"reason", "scan 3 contradicts the others"}}.dump());
    return folder_ / name;
  }
  void refused(const nlohmann::json& report, const std::vector<std::string>& parts) {
    expect_input_error([&] { read_series_run(run("bad", report)); }, parts);
  }
  TemporaryFolder folder_;
  const nlohmann::json good_ = report_with({0.01, -0.02}, hour(0));
};

TEST_F(SeriesRunFile, IsFoundByAnyOfItsNames) {
  const auto path = run("run-1", good_);
  for (const auto& name :
       {path, path / "", path / "inspection", path / "inspection/report.json", path / "../run-1"}) {
    const SeriesRun r = read_series_run(name);
    EXPECT_EQ(r.name, "run-1") << name;
    EXPECT_EQ(r.part, "bracket");
    EXPECT_EQ(r.cad, "bracket.stl");
    EXPECT_EQ(r.cad_sha256, std::string(64, 'a'));
    EXPECT_EQ(r.tolerance_mm, 0.2);
    EXPECT_TRUE(r.simulated);
    EXPECT_EQ(r.doubt, "");
    ASSERT_EQ(r.faces.size(), 2u);
    EXPECT_EQ(r.faces[1].name, "plane 2");
    EXPECT_EQ(r.faces[1].mean_mm, -0.02);
    EXPECT_EQ(r.faces[1].uncertainty_mm, 0.004);
  }
}

TEST_F(SeriesRunFile, ARunThatIsNotToBeReliedOnCountsForNothing) {
  EXPECT_NE(read_series_run(run("u", good_, false)).doubt.find("scan 3 contradicts"), std::string::npos);
  nlohmann::json undecided = good_;
  undecided["verdict"] = "UNDECIDED";
  undecided["faces"].clear();
  EXPECT_EQ(read_series_run(run("v", undecided)).doubt, "UNDECIDED: All is within tolerance.");
}

TEST_F(SeriesRunFile, WhatWasNotSeenIsLeftOut) {
  nlohmann::json json = good_;
  json["faces"][0]["points"] = 0;
  json["faces"][0]["mean_mm"] = nullptr;
  json["faces"][1]["uncertainty_mm"] = nullptr;
  const SeriesRun r = read_series_run(run("a", json));
  ASSERT_EQ(r.faces.size(), 1u);
  EXPECT_TRUE(std::isnan(r.faces[0].uncertainty_mm));
}

TEST_F(SeriesRunFile, MistakesAreNamed) {
  const auto with = [&](const std::string& pointer, const nlohmann::json& value) {
    nlohmann::json json = good_;
    json[nlohmann::json::json_pointer(pointer)] = value;
    return json;
  };
  const std::string file = "report.json";
  refused(with("/verdict", "MAYBE"), {file, "verdict", "MAYBE"});
  refused(with("/created", 3), {file, "created", "text"});
  refused(with("/tolerance_mm", -1), {file, "tolerance_mm", "positive"});
  refused(with("/tolerance_mm", nullptr), {file, "tolerance_mm", "number"});
  refused(with("/simulated", "no"), {file, "simulated"});
  refused(with("/faces", 7), {file, "faces", "list"});
  refused(with("/faces/0", 7), {file, "faces[0]", "object"});
  refused(with("/faces/1/name", "plane 1"), {file, "faces[1].name", "twice"});
  refused(with("/faces/1/mean_mm", nullptr), {file, "faces[1].mean_mm", "number"});
  refused(with("/faces/1/mean_mm", 1e300), {file, "faces[1].mean_mm", "plausible"});
  refused(with("/faces/1/sigma_mm", -0.1), {file, "faces[1].sigma_mm", "negative"});
  refused(with("/traceability", nlohmann::json::object()), {file, "sha256"});
  refused(with("/faces", nlohmann::json::array()), {file, "no faces", "inspect this run again"});
  refused(nlohmann::json::array(), {file, "object"});
  expect_input_error([&] { read_series_run(folder_ / "none"); }, {"none", "no such run"});
  std::filesystem::create_directory(folder_ / "empty");
  expect_input_error([&] { read_series_run(folder_ / "empty"); },
                     {"empty", "report.json", "was this run inspected"});
  const std::string text = good_.dump();
  for (size_t part = 0; part < 20; ++part)
    expect_input_error(
        [&] { read_series_run(folder_.write("cut.json", text.substr(0, text.size() * part / 20))); },
        {"cut.json", "JSON"});
}

TEST_F(SeriesRunFile, ASeriesIsPutInTheOrderOfItsDates) {
  const Series series = make_series({read_series_run(run("c", report_with({3}, hour(5)))),
                                     read_series_run(run("a", report_with({1}, hour(1)))),
                                     read_series_run(run("b", report_with({2}, hour(3))))});
  EXPECT_EQ(series.runs[0].name + series.runs[1].name + series.runs[2].name, "abc");
  EXPECT_TRUE(series.warnings.empty());
}

TEST_F(SeriesRunFile, RunsThatMakeNoSeriesAreRefused) {
  const SeriesRun a = read_series_run(run("a", report_with({1}, hour(1))));
  const SeriesRun b = read_series_run(run("b", report_with({2}, hour(2))));
  expect_input_error([&] { make_series({a}); }, {"at least two runs", "found 1"});
  expect_input_error([&] { make_series({a, b, a}); }, {"a is given twice"});
  const SeriesRun copy = read_series_run(run("copy", report_with({1}, hour(1))));
  expect_input_error(
      [&] {
        make_series({a, b, copy});
      },
      {"copy is given twice", "a is the same measurement"});
  const SeriesRun other = read_series_run(run("other", report_with({1}, hour(3), std::string(64, 'b'))));
  expect_input_error(
      [&] {
        make_series({a, other});
      },
      {"other", "another CAD model", "aaaaaaaaaaaa", "bbbbbbbbbbbb"});
}

TEST_F(SeriesRunFile, OddSeriesAreWarnedOf) {
  nlohmann::json odd = report_with({2}, hour(2));
  odd["tolerance_mm"] = 0.1;
  odd["simulated"] = false;
  const Series series = make_series({read_series_run(run("a", good_)), read_series_run(run("b", odd))});
  ASSERT_EQ(series.warnings.size(), 2u);
  EXPECT_NE(series.warnings[0].find("0.1 to 0.2"), std::string::npos);
  EXPECT_NE(series.warnings[1].find("1 of 2 runs are simulated"), std::string::npos);
}

TEST_F(SeriesRunFile, PagesAndJsonHoldWhatWasFound) {
  Series series = series_of(normal_values(20, 0.02, 0.01, 3));
  series.runs[4].doubt = "UNDECIDED: <script>alert(1)</script>";
  series.runs[7].name = "a <b>\xff";  // not UTF-8
  series.runs[19].faces[0].mean_mm = 0.5;
  const TrendOptions options{.baseline = 10};
  const Trend trend = analyse_trend(series, options);
  const auto page = write_trend(folder_.path(), series, trend, options, "2026-03-02", "gantry test");
  const std::string html = TemporaryFolder::read(page);
  EXPECT_EQ(page.filename(), "trend.html");
  for (const char* expected :
       {"OUT OF CONTROL", "plane 1", "Western Electric 1", "baseline", "&lt;script&gt;", "UCL"})
    EXPECT_NE(html.find(expected), std::string::npos) << expected;
  EXPECT_EQ(html.find("<script>alert"), std::string::npos);
  EXPECT_EQ(html.find("http"), std::string::npos) << "nothing is loaded from elsewhere";
  EXPECT_EQ(html.find("nan"), std::string::npos);
  const nlohmann::json json = nlohmann::json::parse(TemporaryFolder::read(folder_ / "trend.json"));
  EXPECT_EQ(json["runs"].size(), 20u);
  EXPECT_EQ(json["runs"][4]["counts"], false);
  EXPECT_EQ(json["faces"][0]["in_control"], false);
  EXPECT_EQ(json["faces"][0]["signals"].back()["last_run"], 19);
  EXPECT_EQ(json["faces"][0]["moving_ranges_mm"][0], nullptr);
}

TEST_F(SeriesRunFile, TheGaugePageHoldsWhatWasFound) {
  GaugeStudy study{"bracket & cell", {}};
  const Series series = series_of(normal_values(12, 0.02, 0.01, 5));
  for (size_t r = 0; r < 12; ++r)
    study.trials.push_back(
        {series.runs[r].report, std::to_string(r / 4), "cell " + std::to_string(r / 2 % 2)});
  const auto page =
      write_gauge(folder_.path(), analyse_gauge_study(study, series.runs), "2026-03-02", "gantry test");
  const std::string html = TemporaryFolder::read(page);
  for (const char* expected : {"bracket &amp; cell", "cell 1", "ndc", "plane 1"})
    EXPECT_NE(html.find(expected), std::string::npos) << expected;
  EXPECT_EQ(html.find("nan"), std::string::npos);
  const nlohmann::json json = nlohmann::json::parse(TemporaryFolder::read(folder_ / "gauge.json"));
  EXPECT_EQ(json["parts"].size(), 3u);
  EXPECT_EQ(json["appraisers"].size(), 2u);
  EXPECT_EQ(json["trials"], 2);
  EXPECT_GT(json["faces"][0]["grr_mm"]["value"], 0);
}

}  // namespace
}  // namespace gantry
