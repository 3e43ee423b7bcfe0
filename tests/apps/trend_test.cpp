// gantry-fusion trend from run folders on disk to table, JSON and page.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "apps/process.h"
#include "apps/test_cell.h"
#include "inspection/series_samples.h"

namespace gantry::testing {
namespace {

class TrendCommand : public ::testing::Test {
 protected:
  /// Runs "run-00" to "run-11"; plane 2 is off from run 8 on.
  TrendCommand() {
    for (size_t r = 0; r < 12; ++r)
      write_run("run-" + std::to_string(10 + r),
                report_with({noise_[r], noise_[11 - r] + (r > 7 ? 0.2 : 0)}, hour(r)));
  }
  void write_run(const std::string& name, const nlohmann::json& report) {
    std::filesystem::create_directories(folder_ / name / "inspection");
    write_text(folder_ / name / "inspection/report.json", report.dump());
  }
  ProcessResult trend(const std::vector<std::string>& more, size_t runs = 12) {
    std::vector<std::string> arguments = {"trend"};
    for (size_t r = 0; r < runs; ++r) arguments.push_back(folder_ / ("run-" + std::to_string(10 + r)));
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_program("gantry-fusion", arguments);
  }
  void refused(const ProcessResult& result, const std::vector<std::string>& fragments) {
    EXPECT_EQ(result.exit_code, 2) << result.out;
    EXPECT_EQ(result.out, "");
    for (const std::string& fragment : fragments)
      EXPECT_NE(result.err.find(fragment), std::string::npos) << "no '" << fragment << "' in " << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
  }
  TemporaryFolder folder_;
  const std::vector<double> noise_ = normal_values(12, 0, 0.01, 21);
};

TEST_F(TrendCommand, TableJsonAndPageTellTheSame) {
  const ProcessResult table = trend({"--baseline", "8", "--rules", "limits", "--out", folder_ / "out"});
  ASSERT_EQ(table.exit_code, 0) << table.err;
  for (const char* expected :
       {"1 of 2 faces out of control", "plane 2", "above the upper limit", "OUT OF CONTROL"})
    EXPECT_NE(table.out.find(expected), std::string::npos) << table.out;
  EXPECT_NE(read_text(folder_ / "out/trend.html").find("plane 2"), std::string::npos);
  const nlohmann::json file = nlohmann::json::parse(read_text(folder_ / "out/trend.json"));
  const ProcessResult printed = trend({"--baseline", "8", "--rules", "limits", "--json"});
  ASSERT_EQ(printed.exit_code, 0);
  const nlohmann::json json = nlohmann::json::parse(printed.out);
  EXPECT_EQ(json["faces"], file["faces"]);
  EXPECT_EQ(json["faces"][0]["in_control"], true);
  EXPECT_EQ(json["faces"][1]["in_control"], false);
  EXPECT_EQ(json["faces"][1]["baseline"], 8);
  EXPECT_EQ(json["beyond_chance"], true);
}

TEST_F(TrendCommand, ARunThatDoesNotCountIsNamed) {
  nlohmann::json undecided = report_with({5, 5}, hour(3));
  undecided["verdict"] = "UNDECIDED";
  undecided["reason"] = "Only 12 % was seen.";
  write_run("run-13", undecided);
  const ProcessResult result = trend({});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("run 4, run-13, does not count: UNDECIDED: Only 12 % was seen."),
            std::string::npos)
      << result.out;
}

TEST_F(TrendCommand, MistakesAreNamed) {
  refused(run_program("gantry-fusion", {"trend"}), {"runs", "--gauge"});
  refused(trend({}, 1), {"at least two runs"});
  refused(trend({folder_ / "run-12"}), {"run-12 is given twice"});
  refused(trend({folder_ / "nothing"}), {"nothing", "no such run"});
  refused(trend({"--baseline", "40"}), {"baseline", "2 to 12"});
  write_text(folder_ / "run-15/inspection/report.json", "{\"verdict\": \"PA");
  refused(trend({}), {"run-15/inspection/report.json", "not valid JSON"});
  write_run("run-15", report_with({1, 1}, hour(5), std::string(64, 'b')));
  refused(trend({}), {"run-15", "another CAD model"});
  EXPECT_EQ(trend({"--rules", "mine"}).exit_code, 2);
  EXPECT_EQ(trend({"--gauge", folder_ / "GAUGE.yaml"}).exit_code, 2) << "runs or a gauge study, not both";
}

TEST_F(TrendCommand, AGaugeStudy) {
  std::string text = "name: two parts\nruns:\n";
  for (size_t r = 0; r < 8; ++r)
    text += "  - { run: run-" + std::to_string(10 + r) + ", part: " + (r % 2 ? "A" : "B") + " }\n";
  write_text(folder_ / "GAUGE.yaml", text);
  const std::string gauge = folder_ / "GAUGE.yaml";
  const ProcessResult result =
      run_program("gantry-fusion", {"trend", "--gauge", gauge, "--out", folder_ / "out"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("two parts: 2 parts, 1 appraiser, 4 trials each"), std::string::npos)
      << result.out;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/gauge.html"));
  const nlohmann::json json = nlohmann::json::parse(read_text(folder_ / "out/gauge.json"));
  EXPECT_EQ(json["faces"].size(), 2u);
  EXPECT_EQ(json["faces"][0]["reproducibility_mm"], nullptr);
  write_text(folder_ / "GAUGE.yaml", replaced(text, "run-14, part: B", "run-14, part: C"));
  refused(run_program("gantry-fusion", {"trend", "--gauge", gauge}),
          {"two parts", "part A has 4 runs where part B has 3", "equally often"});
  write_text(folder_ / "GAUGE.yaml", replaced(text, "run-14", "run-99"));
  refused(run_program("gantry-fusion", {"trend", "--gauge", gauge}), {"run-99", "no such run"});
}

}  // namespace
}  // namespace gantry::testing
