// Every mistake a person can make with files and options ends in one clear message that names file and
// line or key, and in exit code 2; nothing is created or moved.

#include <gtest/gtest.h>

#include "apps/process.h"
#include "apps/test_cell.h"

namespace gantry::testing {
namespace {

class BadInput : public ::testing::Test {
 protected:
  BadInput() {
    write_text(folder_ / "cell.yaml", simulated_cell_text());
    write_text(folder_ / "plan.yaml", kThreeViews);
  }

  ProcessResult run_cell() {
    return run_program("gantry-cell", {"run", "--cell", folder_ / "cell.yaml", "--plan", folder_ / "plan.yaml", "--reference",
                                       reference_, "--out", folder_ / "run"});
  }

  void expect_refused(const ProcessResult& result, const std::vector<std::string>& fragments) {
    EXPECT_EQ(result.exit_code, 2) << result.out << result.err;
    EXPECT_EQ(result.out, "");
    for (const std::string& fragment : fragments) EXPECT_NE(result.err.find(fragment), std::string::npos) << result.err;
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << "one message, one line: " << result.err;
    EXPECT_FALSE(std::filesystem::exists(folder_ / "run")) << "nothing may be created";
  }

  TemporaryFolder folder_;
  std::string reference_ = (kExamples / "parts/bracket.stl").string();
};

TEST_F(BadInput, MissingCell) {
  std::filesystem::remove(folder_ / "cell.yaml");
  expect_refused(run_cell(), {"cell.yaml", "cannot be opened"});
}

TEST_F(BadInput, BrokenCell) {
  write_text(folder_ / "cell.yaml", "name: x\naxes: [unclosed\n");
  expect_refused(run_cell(), {"cell.yaml:", "not valid YAML"});
}

TEST_F(BadInput, UnknownKeyInCell) {
  write_text(folder_ / "cell.yaml", replaced(simulated_cell_text(), "name: linear\n", "name: linear\n    sped: 3\n"));
  expect_refused(run_cell(), {"cell.yaml:", "axes[0].sped", "unknown key"});
}

TEST_F(BadInput, InvertedLimits) {
  write_text(folder_ / "cell.yaml", replaced(simulated_cell_text(), "soft_limits_deg: [-75, 75]", "soft_limits_deg: [75, -75]"));
  expect_refused(run_cell(), {"cell.yaml:", "axes[2].motion.soft_limits_deg", "[75, -75]"});
}

TEST_F(BadInput, AStageThatWouldNeverArrive) {
  write_text(folder_ / "cell.yaml", replaced(simulated_cell_text(), "max_speed_mm_s: 200", "max_speed_mm_s: 0"));
  expect_refused(run_cell(), {"cell.yaml:", "simulation.stages[0].max_speed_mm_s", "found 0"});
}

TEST_F(BadInput, MissingPlan) {
  std::filesystem::remove(folder_ / "plan.yaml");
  expect_refused(run_cell(), {"plan.yaml", "cannot be opened"});
}

TEST_F(BadInput, BrokenPlan) {
  write_text(folder_ / "plan.yaml", "viewpoints: 3\n");
  expect_refused(run_cell(), {"plan.yaml:1", "missing key 'name'"});
}

TEST_F(BadInput, ViewpointOutsideASoftLimit) {
  write_text(folder_ / "plan.yaml", replaced(kThreeViews, "rotation_deg: 0, tilt_deg: 10", "rotation_deg: 0, tilt_deg: 76"));
  expect_refused(run_cell(), {"plan.yaml:6", "tilt_deg", "76", "soft limits", "-75.000 to 75.000"});
}

TEST_F(BadInput, MissingReference) {
  reference_ = folder_ / "none.stl";
  expect_refused(run_cell(), {"none.stl", "no such file"});
}

TEST_F(BadInput, BrokenReference) {
  reference_ = folder_ / "broken.stl";
  write_text(reference_, "this is not a mesh");
  expect_refused(run_cell(), {"broken.stl"});
  const std::string good = read_text(kExamples / "parts/bracket.stl");
  write_text(reference_, good.substr(0, good.size() / 2));
  expect_refused(run_cell(), {"broken.stl"});
}

TEST_F(BadInput, RunFolderInUse) {
  std::filesystem::create_directories(folder_ / "run");
  write_text(folder_ / "run/notes.txt", "mine");
  const ProcessResult result = run_cell();
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_NE(result.err.find("not an empty folder"), std::string::npos) << result.err;
  EXPECT_EQ(read_text(folder_ / "run/notes.txt"), "mine");
}

TEST_F(BadInput, WrongOptions) {
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{}, {"run"}, {"fly"}, {"run", "--cell"}, {"status", "--cel", "x"}}) {
    const ProcessResult result = run_program("gantry-cell", arguments);
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_NE(result.err, "");
  }
}

class BadScans : public BadInput {
 protected:
  ProcessResult run_register(const std::vector<std::string>& scans) {
    std::vector<std::string> arguments = {"register"};
    arguments.insert(arguments.end(), scans.begin(), scans.end());
    arguments.insert(arguments.end(), {"--initial", folder_ / "poses.txt", "--out", folder_ / "run", "--log-level", "warn"});
    return run_program("gantry-fusion", arguments);
  }
  std::string ply(int count, const std::string& body) {
    return "ply\nformat ascii 1.0\nelement vertex " + std::to_string(count) +
           "\nproperty float x\nproperty float y\nproperty float z\nend_header\n" + body;
  }
  const std::string identity_ = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
};

TEST_F(BadScans, MissingAndBrokenPly) {
  write_text(folder_ / "poses.txt", identity_);
  expect_refused(run_register({folder_ / "none.ply"}), {"none.ply", "no such file"});
  std::filesystem::create_directory(folder_ / "folder.ply");
  expect_refused(run_register({folder_ / "folder.ply"}), {"folder.ply", "a scan file or a run folder is expected"});
  write_text(folder_ / "broken.ply", "ply\nnonsense\n");
  expect_refused(run_register({folder_ / "broken.ply"}), {"broken.ply"});
  write_text(folder_ / "empty.ply", ply(0, ""));
  expect_refused(run_register({folder_ / "empty.ply"}), {"empty.ply", "no points"});
  write_text(folder_ / "nan.ply", ply(2, "nan nan nan\nnan nan nan\n"));
  expect_refused(run_register({folder_ / "nan.ply"}), {"nan.ply", "no finite point"});
  write_text(folder_ / "one.ply", ply(1, "1 2 3\n"));
  expect_refused(run_register({folder_ / "one.ply"}), {"one.ply", "at least 100"});
}

TEST_F(BadScans, PosesFile) {
  write_text(folder_ / "one.ply", ply(1, "1 2 3\n"));
  expect_refused(run_register({folder_ / "one.ply"}), {"poses.txt", "cannot be opened"});
  write_text(folder_ / "poses.txt", identity_ + identity_);
  expect_refused(run_register({folder_ / "one.ply"}), {"poses.txt", "holds 2 poses", "1 scans"});
  write_text(folder_ / "poses.txt", "# comment\n\n1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n");
  expect_refused(run_register({folder_ / "one.ply"}), {"poses.txt:4", "four finite numbers"});
  write_text(folder_ / "poses.txt", "2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
  expect_refused(run_register({folder_ / "one.ply"}), {"poses.txt:4", "not rigid"});
}

TEST_F(BadScans, InspectOptions) {
  write_text(folder_ / "one.ply", ply(1, "1 2 3\n"));
  const auto inspect = [&](const std::string& tolerance) {
    return run_program("gantry-fusion", {"inspect", "--cloud", folder_ / "one.ply", "--reference", reference_, "--tolerance",
                                         tolerance, "--out", folder_ / "out"});
  };
  EXPECT_EQ(inspect("-1").exit_code, 2);
  EXPECT_EQ(inspect("abc").exit_code, 2);
  // One point says nothing about a part: neither PASS nor FAIL.
  EXPECT_EQ(inspect("0.2").exit_code, 4);
}

}  // namespace
}  // namespace gantry::testing
