// gantry-fusion register: the files it writes, its exit codes, and what it refuses.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <iomanip>
#include <nlohmann/json.hpp>

#include "apps/process.h"
#include "apps/test_cell.h"
#include "gantry/acquisition/journal.h"
#include "gantry/geometry/scan_file.h"

namespace gantry::testing {
namespace {

constexpr size_t kViews = 8;

/// POSES.txt without comments.
std::vector<Eigen::Matrix4d> poses_in(const std::filesystem::path& path) {
  std::vector<double> numbers;
  std::istringstream lines(read_text(path));
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line.substr(0, line.find('#')));
    for (double number; words >> number;) numbers.push_back(number);
  }
  std::vector<Eigen::Matrix4d> poses;
  for (size_t i = 0; i + 16 <= numbers.size(); i += 16)
    poses.push_back(Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers.data() + i));
  return poses;
}

/// Simulated scans of the bracket, made once: scan_00.pcd ..., truth.txt, initial.txt 1 to 3 mm and deg off.
class Register : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    scans_ = new TemporaryFolder;
    const ProcessResult made =
        run_program("gantry-parts", {"--scans", scans_->path(), "--part", kExamples / "parts/bracket.stl",
                                     "--views", std::to_string(kViews), "--width", "960", "--band", "1,3"});
    ASSERT_EQ(made.exit_code, 0) << made.err;
  }
  static void TearDownTestSuite() { delete scans_; }

  static std::string scan(size_t i) { return *scans_ / ("scan_0" + std::to_string(i) + ".pcd"); }
  static std::vector<std::string> all_scans() {
    std::vector<std::string> all;
    for (size_t i = 0; i < kViews; ++i) all.push_back(scan(i));
    return all;
  }
  std::string out() const { return folder_ / "out"; }

  ProcessResult run(const std::vector<std::string>& scans, const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"register"};
    arguments.insert(arguments.end(), scans.begin(), scans.end());
    arguments.insert(arguments.end(), {"--out", out(), "--log-level", "warn"});
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_program("gantry-fusion", arguments);
  }
  ProcessResult run_all(std::vector<std::string> more = {}) {
    more.insert(more.end(), {"--initial", *scans_ / "initial.txt"});
    return run(all_scans(), more);
  }
  nlohmann::json result() const { return nlohmann::json::parse(read_text(out() + "/registration.json")); }

  /// What is left of the options is wrong: tells so without any computation.
  void expect_wrong_option(const std::vector<std::string>& options, const std::vector<std::string>& fragments) {
    const ProcessResult process = run_all(options);
    EXPECT_EQ(process.exit_code, 2) << process.out << process.err;
    for (const std::string& fragment : fragments)
      EXPECT_NE(process.err.find(fragment), std::string::npos) << fragment << " in " << process.err;
    EXPECT_LT(process.err.size(), 200u) << process.err;
  }

  /// One message on one line, exit code 2, and nothing created.
  void expect_refused(const ProcessResult& process, const std::vector<std::string>& fragments) {
    EXPECT_EQ(process.exit_code, 2) << process.out << process.err;
    EXPECT_EQ(process.out, "");
    EXPECT_EQ(std::count(process.err.begin(), process.err.end(), '\n'), 1) << process.err;
    for (const std::string& fragment : fragments)
      EXPECT_NE(process.err.find(fragment), std::string::npos) << fragment << " in " << process.err;
    EXPECT_FALSE(std::filesystem::exists(out()));
  }

  inline static TemporaryFolder* scans_ = nullptr;
  TemporaryFolder folder_;
};

TEST_F(Register, FindsThePosesAndSaysSo) {
  const ProcessResult process = run_all();
  EXPECT_EQ(process.exit_code, 0) << process.err;
  EXPECT_EQ(process.err, "");
  for (const char* word : {"scan_07.pcd", "moved (mm)", "the reference", "method     joint", "merged.ply"})
    EXPECT_NE(process.out.find(word), std::string::npos) << word << " in " << process.out;
  const auto found = poses_in(out() + "/poses.txt"), truth = poses_in(*scans_ / "truth.txt"),
             initial = poses_in(*scans_ / "initial.txt");
  ASSERT_EQ(found.size(), kViews);
  EXPECT_TRUE(found[0].isApprox(initial[0], 1e-12));
  const Eigen::Vector4d middle(60, 0, 20, 1);
  for (size_t i = 1; i < kViews; ++i) {
    const Eigen::Matrix4d gauge = truth[0] * found[0].inverse();
    EXPECT_LT((gauge * found[i] * truth[i].inverse() * middle - middle).norm(), 0.05) << i;
    EXPECT_GT((initial[i] * truth[i].inverse() * middle - middle).norm(), 0.5) << i;
  }
}

TEST_F(Register, NumbersOutOfAllReasonAreRefused) {
  expect_wrong_option({"--prior", "nan,1"}, {"--prior", "found nan"});
  expect_wrong_option({"--prior", "15,1e300"}, {"--prior", "found 1e300"});
  expect_wrong_option({"--noise", "0"}, {"--noise", "from 0.0001 to 100", "found 0"});
  expect_wrong_option({"--start", "inf"}, {"--start", "found inf"});
  expect_wrong_option({"--merge-voxel", "1e-9"}, {"--merge-voxel", "from 0.001", "found 1e-9"});
  expect_wrong_option({"--method", "pose-graph", "--m", "nan"}, {"--m", "from 1 to 4", "found nan"});
}

TEST_F(Register, AFolderThatCannotBeMadeIsToldBeforeTheWork) {
  write_text(folder_ / "file", "mine");
  const ProcessResult process = run_program(
      "gantry-fusion", {"register", scan(0), "--initial", *scans_ / "none.txt", "--out", folder_ / "file/deep/out"});
  EXPECT_EQ(process.exit_code, 2);
  for (const char* fragment : {"--out", "file is a file", "a folder is expected"})
    EXPECT_NE(process.err.find(fragment), std::string::npos) << fragment << " in " << process.err;
}

TEST_F(Register, ScansInAnotherUnitAreToldByTheirSize) {
  const ProcessResult process = run_all({"--unit", "m", "--no-merge"});
  EXPECT_NE(process.err.find("scan_00.pcd: is "), std::string::npos) << process.err;
  EXPECT_NE(process.err.find("--unit"), std::string::npos) << process.err;
}

/// POSES.txt of these poses, in a unit of so many mm, after everything was moved.
std::string poses_text(const std::vector<Eigen::Matrix4d>& poses, double unit_mm, const Eigen::Vector3d& moved_mm) {
  std::ostringstream text;
  text << std::setprecision(17);
  for (Eigen::Matrix4d pose : poses) {
    pose.topRightCorner<3, 1>() = (pose.topRightCorner<3, 1>() + moved_mm) / unit_mm;
    text << pose << "\n";
  }
  return text.str();
}

/// How far apart two sets of poses put the bracket's corners, in mm.
double furthest_mm(const std::vector<Eigen::Matrix4d>& a, const std::vector<Eigen::Matrix4d>& b) {
  double furthest = 0;
  for (size_t i = 0; i < kViews; ++i)
    for (int corner = 0; corner < 8; ++corner) {
      const Eigen::Vector4d p(corner & 1 ? 120 : 0, corner & 2 ? 20 : -20, corner & 4 ? 40 : 0, 1);
      furthest = std::max(furthest, (a.at(i) * b.at(i).inverse() * p - p).norm());
    }
  return furthest;
}

TEST_F(Register, MetresGiveTheSamePosesAsMillimetres) {
  std::vector<std::string> metres;
  for (size_t i = 0; i < kViews; ++i) {
    const Scan scan = read_scan(this->scan(i)).scan;
    metres.push_back(folder_ / (std::to_string(i) + ".pcd"));
    std::ofstream file(metres.back(), std::ios::binary);
    file << "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " << scan.width << "\nHEIGHT "
         << scan.height << "\nDATA binary\n";
    for (const Eigen::Vector3f& point : scan.points) {
      const Eigen::Vector3d p = point.cast<double>() / 1000;
      file.write(reinterpret_cast<const char*>(p.data()), 3 * sizeof(double));
    }
  }
  const auto initial = poses_in(*scans_ / "initial.txt");
  write_text(folder_ / "m.txt", poses_text(initial, 1000, {0, 0, 0}));
  run_all({"--no-merge"});
  const auto in_mm = poses_in(out() + "/poses.txt");
  const ProcessResult process = run(metres, {"--no-merge", "--unit", "m", "--initial", folder_ / "m.txt", "--initial-unit", "m"});
  EXPECT_EQ(process.exit_code, 0) << process.err;
  EXPECT_EQ(process.err, "") << "no doubt about the unit";
  EXPECT_LT(furthest_mm(in_mm, poses_in(out() + "/poses.txt")), 1e-5);
}

TEST_F(Register, TheOriginMayLieTenMetresAway) {
  const Eigen::Vector3d away(6000, -7000, 4000);
  write_text(folder_ / "far.txt", poses_text(poses_in(*scans_ / "initial.txt"), 1, away));
  run_all({"--no-merge"});
  const auto here = poses_in(out() + "/poses.txt");
  EXPECT_EQ(run(all_scans(), {"--no-merge", "--initial", folder_ / "far.txt"}).exit_code, 0);
  auto back = poses_in(out() + "/poses.txt");
  for (Eigen::Matrix4d& pose : back) pose.topRightCorner<3, 1>() -= away;
  EXPECT_LT(furthest_mm(here, back), 1e-5);
}

TEST_F(Register, TheUnitOfPosesThatAreNotGivenIsRefused) {
  const ProcessResult process = run(all_scans(), {"--initial-unit", "m"});
  EXPECT_EQ(process.exit_code, 2);
  EXPECT_NE(process.err.find("--initial-unit requires --initial"), std::string::npos) << process.err;
}

TEST_F(Register, WritesWhatItKnows) {
  ASSERT_EQ(run_all().exit_code, 0);
  const nlohmann::json json = result();
  EXPECT_EQ(json.at("method"), "joint");
  EXPECT_TRUE(json.at("trusted").get<bool>());
  EXPECT_TRUE(json.at("converged").get<bool>());
  EXPECT_EQ(json.at("reason"), "");
  EXPECT_NE(json.at("way"), "");
  EXPECT_LT(json.at("wobble_mm").get<double>(), 0.2);
  EXPECT_GT(json.at("parameters").at("noise_mm").at("value").get<double>(), 0);
  EXPECT_NE(json.at("parameters").at("noise_mm").at("reason"), "");
  EXPECT_LT(json.at("overlap_rms_mm").at("after").get<double>(),
            json.at("overlap_rms_mm").at("before").get<double>());
  EXPECT_GT(json.at("merged").at("points").get<int>(), 10000);
  EXPECT_GT(json.at("peak_memory_mb").get<double>(), 1);
  for (const char* stage : {"preprocess", "register", "residuals", "merge"})
    EXPECT_GT(json.at("timings_s").at(stage).get<double>(), 0) << stage;
  ASSERT_EQ(json.at("scans").size(), kViews);
  for (const nlohmann::json& one : json.at("scans")) {
    EXPECT_EQ(one.at("world_from_scan").size(), 4u);
    EXPECT_EQ(one.at("covariance").size(), 6u);
    EXPECT_NE(one.at("observability"), "");
    EXPECT_TRUE(one.at("connected").get<bool>());
    EXPECT_GT(one.at("matches").get<int>(), 100);
    EXPECT_GT(one.at("points").at("used").get<int>(), 1000);
    EXPECT_LE(one.at("points").at("used"), one.at("points").at("measured"));
    for (const char* key :
         {"rms_mm", "moved_mm", "turned_deg", "noise_mm", "spacing_mm", "matches_rms_mm",
          "free_space_violation", "opposite_contact", "prior_chi_square", "leave_one_out_mm"})
      EXPECT_GE(one.at(key).get<double>(), 0) << key;
  }
  ASSERT_FALSE(json.at("edges").empty());
  for (const nlohmann::json& edge : json.at("edges")) {
    EXPECT_LT(edge.at("target").get<size_t>(), edge.at("source").get<size_t>());
    for (const char* key : {"overlap", "inliers", "rms_mm", "disagreement_mm"})
      EXPECT_GE(edge.at(key).get<double>(), 0) << key;
    EXPECT_TRUE(edge.at("predicted_overlap").is_null());
    EXPECT_TRUE(edge.at("kept").is_boolean() && edge.at("reason").is_string() && edge.at("kind").is_string());
  }
}

TEST_F(Register, EveryMethodCanBeChosen) {
  for (const std::string method : {"refined-pose-graph", "pose-graph", "global-icp"}) {
    const ProcessResult process = run(all_scans(), {"--initial", *scans_ / "truth.txt", "--method", method,
                                                    "--prior", "0.5,0.5", "--json", "--no-merge"});
    const bool trusted = nlohmann::json::parse(process.out).at("trusted").get<bool>();
    EXPECT_EQ(process.exit_code, trusted ? 0 : 4) << method << ": " << process.err;
    // Global ICP need not come to rest, but then it has to say so.
    if (method != "global-icp") {
      EXPECT_TRUE(trusted) << method << ": " << process.err;
    }
    EXPECT_EQ(result().at("method"), method);
    EXPECT_TRUE(result().at("wobble_mm").is_null()) << "this method has no such test";
    EXPECT_TRUE(result().at("shared_chi_square").is_null());
    EXPECT_TRUE(result().at("scans").at(1).at("prior_chi_square").is_null());
    EXPECT_GE(result().at("edges").at(0).at("predicted_overlap").get<double>(), 0);
    EXPECT_FALSE(result().at("edges").empty());
  }
}

TEST_F(Register, ThreadsDoNotChangeThePoses) {
  ASSERT_EQ(run_all({"--threads", "1"}).exit_code, 0);
  const std::string one = read_text(out() + "/poses.txt");
  ASSERT_EQ(run_all({"--threads", "2"}).exit_code, 0);
  EXPECT_EQ(read_text(out() + "/poses.txt"), one);
}

TEST_F(Register, WithoutMergingNoOldCloudIsLeftBehind) {
  std::filesystem::create_directories(out());
  write_text(out() + "/merged.ply", "of other poses");
  ASSERT_EQ(run_all({"--no-merge"}).exit_code, 0);
  EXPECT_FALSE(std::filesystem::exists(out() + "/merged.ply"));
  EXPECT_TRUE(result().at("merged").is_null());
}

TEST_F(Register, OptionsOfAnotherMethodAreRefused) {
  const auto refused = [&](const std::string& method, const std::string& option, const std::string& value) {
    expect_refused(run_all({"--method", method, option, value}), {option, "not used by method " + method});
  };
  for (const char* option : {"--voxel-size", "--m", "--p", "--edge-prune-threshold"}) {
    refused("joint", option, "2");
    refused("global-icp", option, "2");
  }
  refused("joint", "--max-distance-threshold", "2");
  refused("joint", "--pairwise", "point-to-plane");
  refused("pose-graph", "--pairwise", "generalized-icp");
  refused("pose-graph", "--sampling", "uniform");
  refused("refined-pose-graph", "--start", "2");
  refused("global-icp", "--noise", "0.1");
}

TEST_F(Register, WrongOptions) {
  for (const std::vector<std::string>& wrong : {std::vector<std::string>{"--method", "icp"},
                                                {"--prior", "3"},
                                                {"--prior", "0,3"},
                                                {"--prior", "3,-1"},
                                                {"--crop", "1,2,3"},
                                                {"--noise", "-1"},
                                                {"--merge-voxel", "0"},
                                                {"--no-merge", "--merge-voxel", "1"}}) {
    const ProcessResult process = run_all(wrong);
    EXPECT_EQ(process.exit_code, 2) << wrong[0] << ": " << process.err;
    EXPECT_NE(process.err.find(wrong[0]), std::string::npos) << process.err;
    EXPECT_FALSE(std::filesystem::exists(out()));
  }
  expect_refused(run_all({"--crop", "0,0,0,10,-10,10"}), {"crop"});
  expect_refused(run_all({"--crop", "500,500,500,510,510,510"}),
                 {"scan_00.pcd", "outside the part's volume"});
  expect_refused(run_all({"--method", "pose-graph", "--m", "2", "--max-distance-threshold", "3"}), {"m and"});
}

TEST_F(Register, AFileInPlaceOfTheFolder) {
  write_text(out(), "mine");
  const ProcessResult process = run_all();
  EXPECT_EQ(process.exit_code, 2);
  EXPECT_NE(process.err.find("a folder is expected"), std::string::npos) << process.err;
  EXPECT_EQ(read_text(out()), "mine");
}

TEST_F(Register, UnusableScansAreNamed) {
  const std::vector<std::string> initial = {"--initial", *scans_ / "initial.txt"};
  const auto instead_of_the_third = [&](const std::string& file) {
    std::vector<std::string> scans = all_scans();
    scans[2] = folder_ / file;
    return run(scans, initial);
  };
  const auto write_ply = [&](const std::string& name, size_t count, const std::string& line) {
    std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(count) +
                       "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (size_t i = 0; i < count; ++i) text += line;
    write_text(folder_ / name, text);
  };
  write_ply("none.ply", 0, "");
  expect_refused(instead_of_the_third("none.ply"), {"none.ply", "no points"});
  write_ply("nan.ply", 300, "nan nan nan\n");
  expect_refused(instead_of_the_third("nan.ply"), {"nan.ply", "no finite point"});
  write_ply("one.ply", 1, "1 2 500\n");
  expect_refused(instead_of_the_third("one.ply"), {"one.ply", "at least 100"});
  write_ply("same.ply", 300, "1 2 500\n");
  expect_refused(instead_of_the_third("same.ply"), {"same.ply"});
  expect_refused(instead_of_the_third("missing.pcd"), {"missing.pcd", "no such file"});
}

TEST_F(Register, TheSameScanTwiceIsRefused) {
  const std::vector<std::string> initial = {"--initial", *scans_ / "initial.txt"};
  std::vector<std::string> scans = all_scans();
  scans[3] = (scans_->path() / "../" / scans_->path().filename() / "scan_01.pcd").string();
  expect_refused(run(scans, initial), {"scan_01.pcd", "given twice"});
  std::filesystem::copy_file(scan(1), folder_ / "copy.pcd");
  scans[3] = folder_ / "copy.pcd";
  expect_refused(run(scans, initial), {"copy.pcd", "same points as scan_01.pcd"});
}

TEST_F(Register, PosesOfTheWrongLength) {
  expect_refused(run({scan(0), scan(1)}, {"--initial", *scans_ / "initial.txt"}),
                 {"initial.txt", "holds 8 poses", "2 scans"});
  expect_refused(run({scan(0), scan(1)}, {}), {"scan_00.pcd", "no VIEWPOINT", "--initial"});
}

TEST_F(Register, ARunIsTakenAsItWasTagged) {
  const auto initial = poses_in(*scans_ / "initial.txt");
  std::filesystem::create_directories(folder_ / "run/scans");
  Journal journal(folder_ / "run/journal.sqlite");
  for (size_t i = 0; i < kViews; ++i) {
    ScanRecord record;
    record.viewpoint = static_cast<int>(i);
    record.file = "scans/" + std::to_string(i) + ".pcd";
    record.part_from_sensor.mean = Pose(Eigen::Isometry3d(initial[i]));
    record.part_from_sensor.independent.diagonal() << 1e-2, 1e-2, 1e-2, 25, 25, 25;
    record.part_from_sensor.shared_factor = SharedFactor::Constant(6, 3, 1e-3);
    write_scan(folder_ / ("run/" + record.file), read_scan(scan(i)).scan, record.part_from_sensor);
    journal.add_scan(record);
  }
  const auto shared_parameters = [&] {
    return result().at("parameters").at("shared_parameters").at("value");
  };
  ASSERT_EQ(run({folder_ / "run"}, {"--no-merge"}).exit_code, 0);
  EXPECT_EQ(shared_parameters(), 3);
  EXPECT_EQ(result().at("scans").size(), kViews);
  std::vector<std::string> files;
  for (size_t i = 0; i < kViews; ++i) files.push_back(folder_ / ("run/scans/" + std::to_string(i) + ".pcd"));
  ASSERT_EQ(run(files, {"--no-merge"}).exit_code, 0);
  EXPECT_EQ(shared_parameters(), 3) << "the files alone say the same";
  ASSERT_EQ(run({folder_ / "run"}, {"--no-merge", "--prior", "5,5"}).exit_code, 0);
  EXPECT_EQ(shared_parameters(), 0) << "what the user says counts";
  ASSERT_EQ(run({folder_ / "run"}, {"--no-merge", "--initial", *scans_ / "initial.txt"}).exit_code, 0);
  EXPECT_EQ(shared_parameters(), 0) << "other poses have another uncertainty";
  std::filesystem::remove_all(out());
  expect_refused(run({folder_ / "run/scans"}, {}), {"run/scans", "a folder without journal.sqlite"});
}

TEST_F(Register, ScansWithNothingInCommonAreUndecided) {
  std::string text;
  for (int i = 0; i < 2; ++i) text += "1 0 0 " + std::to_string(1000 * i) + "\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";
  write_text(folder_ / "far.txt", text);
  const ProcessResult process = run({scan(0), scan(1)}, {"--initial", folder_ / "far.txt", "--prior", "1,1"});
  EXPECT_EQ(process.exit_code, 4) << process.out;
  for (const char* word : {"UNDECIDED", "scan_01.pcd", "What to do"})
    EXPECT_NE(process.err.find(word), std::string::npos) << process.err;
  EXPECT_NE(process.out.find("NOT CONNECTED"), std::string::npos) << process.out;
  EXPECT_FALSE(result().at("trusted").get<bool>());
  EXPECT_NE(result().at("advice"), "");
  EXPECT_FALSE(result().at("scans").at(1).at("connected").get<bool>());
  EXPECT_TRUE(std::filesystem::exists(out() + "/merged.ply"));
}

TEST_F(Register, OneScanIsItsOwnResult) {
  write_text(folder_ / "one.txt", "1 0 0 3\n0 1 0 2\n0 0 1 1\n0 0 0 1\n");
  const ProcessResult process = run({scan(0)}, {"--initial", folder_ / "one.txt"});
  EXPECT_EQ(process.exit_code, 0) << process.err;
  EXPECT_EQ(poses_in(out() + "/poses.txt").at(0)(0, 3), 3);
}

TEST_F(Register, TheViewpointOfThePcdIsThePose) {
  const auto initial = poses_in(*scans_ / "initial.txt");
  std::vector<std::string> scans;
  for (size_t i = 0; i < kViews; ++i) {
    // Names may repeat in different folders.
    std::filesystem::create_directories(folder_ / std::to_string(i));
    scans.push_back(folder_ / (std::to_string(i) + "/scan.pcd"));
    write_scan(scans.back(), read_scan(scan(i)).scan, Pose(Eigen::Isometry3d(initial[i])));
  }
  const ProcessResult process = run(scans, {});
  EXPECT_EQ(process.exit_code, 0) << process.err;
  EXPECT_NE(process.out.find("/3/scan.pcd"), std::string::npos) << process.out;
  ASSERT_EQ(run_all().exit_code, 0);
  const auto a = poses_in(out() + "/poses.txt");
  ASSERT_EQ(run(scans, {}).exit_code, 0);
  const auto b = poses_in(out() + "/poses.txt");
  for (size_t i = 0; i < kViews; ++i) EXPECT_LT((a[i] - b[i]).cwiseAbs().maxCoeff(), 1e-3) << i;
}

}  // namespace
}  // namespace gantry::testing
