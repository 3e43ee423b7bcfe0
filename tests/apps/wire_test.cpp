// The whole river in separate processes: gantry-twin serves the cell over Modbus TCP and GigE Vision on
// loopback, gantry-cell runs the shipped plan against it, and the report is compared with the truth.

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <csignal>
#include <nlohmann/json.hpp>

#include "apps/process.h"
#include "apps/test_cell.h"

namespace gantry::testing {
namespace {

Eigen::Vector3d vector(const nlohmann::json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

/// Runs the plan on a part and returns report.json.
nlohmann::json inspect_part(const TemporaryFolder& folder, const std::string& part, int seed, int expected_exit_code) {
  write_text(folder / "cell.yaml", twin_cell_text());
  BackgroundProgram twin("gantry-twin", {"--cell", folder / "cell.yaml", "--part", (kExamples / "parts" / part).string(),
                                         "--seed", std::to_string(seed)});
  EXPECT_TRUE(twin.wait_for_line("ready", 30));
  const std::string out = folder / "run";
  const ProcessResult run =
      run_program("gantry-cell",
                  {"run", "--cell", folder / "cell.yaml", "--plan", (kExamples / "plans/bracket.yaml").string(),
                   "--reference", (kExamples / "parts/bracket.stl").string(), "--out", out},
                  250);
  EXPECT_EQ(run.exit_code, expected_exit_code) << run.out << run.err;
  EXPECT_EQ(run.out.find('\r'), std::string::npos) << "progress is for terminals only";
  EXPECT_TRUE(std::filesystem::exists(out + "/inspection/report.html"));
  EXPECT_TRUE(std::filesystem::exists(out + "/inspection/deviations.ply"));
  EXPECT_TRUE(std::filesystem::exists(out + "/registration/merged.ply"));
  twin.send_signal(SIGTERM);
  EXPECT_EQ(twin.wait(), 0);
  return nlohmann::json::parse(read_text(out + "/inspection/report.json"));
}

TEST(OnTheWire, GoodPartPassesWithoutASingleDefect) {
  TemporaryFolder folder;
  const nlohmann::json report = inspect_part(folder, "bracket.stl", 3, 0);
  EXPECT_EQ(report.at("verdict"), "PASS");
  EXPECT_TRUE(report.at("defects").empty()) << report.at("defects").dump(1);
  EXPECT_GT(report.at("coverage").get<double>(), 0.9);
  EXPECT_GT(report.at("point_classes").at("fixture").get<int>(), 1000) << "the holder is seen, and known as fixture";
  EXPECT_TRUE(report.at("simulated").get<bool>());
  const std::string calibration = report.at("traceability").at("Calibration");
  EXPECT_EQ(calibration.rfind("nominal-2026-01, of 2026-01-15, ", 0), 0u) << calibration;
}

TEST(OnTheWire, SeededDefectsAreFoundAtTheirPlaceAndDepthAndNoOthers) {
  TemporaryFolder folder;
  const nlohmann::json report = inspect_part(folder, "bracket_defective.stl", 4, 1);
  EXPECT_EQ(report.at("verdict"), "FAIL");
  const nlohmann::json truth = nlohmann::json::parse(read_text(kExamples / "parts/bracket_defective.truth.json"));
  EXPECT_EQ(report.at("defects").size(), truth.at("defects").size()) << report.at("defects").dump(1);
  for (const nlohmann::json& expected : truth.at("defects")) {
    const std::string kind = expected.at("kind");
    const nlohmann::json* nearest = nullptr;
    double best_mm = 1e9;
    for (const nlohmann::json& found : report.at("defects")) {
      const double distance_mm = (vector(found.at("centre_mm")) - vector(expected.at("centre_mm"))).norm();
      if (distance_mm < best_mm) {
        best_mm = distance_mm;
        nearest = &found;
      }
    }
    ASSERT_NE(nearest, nullptr) << kind;
    EXPECT_LT(best_mm, 2.0) << kind;
    EXPECT_NEAR(std::abs(nearest->at("peak_mm").get<double>()), expected.at("depth_mm").get<double>(), 0.1) << kind;
    EXPECT_TRUE(nearest->at("certain").get<bool>()) << kind;
  }
}

}  // namespace
}  // namespace gantry::testing
