#include "gantry/acquisition/run.h"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <set>

#include "acquisition/edited_file.h"
#include "gantry/geometry/scan_file.h"
#include "gantry/sim/bracket.h"
#include "gantry/sim/devices.h"

namespace gantry {
namespace {

constexpr double kDeg = std::numbers::pi / 180;
using Facts = std::map<std::string, std::string>;

const Cell& cell() {
  static const Cell cell =
      read_cell(std::filesystem::path(GANTRY_SOURCE_DIR) / "examples/cells/simulated.yaml");
  return cell;
}

Plan three_views() {
  Plan plan;
  plan.name = "three views";
  // Between the encoders' steps, so that the positions read differ from those commanded.
  plan.viewpoints = {{"top", {100.004, 0, 54.002 * kDeg}},
                     {"right", {100.003, 45.001 * kDeg, 0}},
                     {"left", {99.996, -45.002 * kDeg, 0}}};
  return plan;
}

/// A scanner that fails as told: the action stands for the k-th capture, from 1.
class ScriptedScanner final : public Scanner {
 public:
  explicit ScriptedScanner(SimulatedWorld& world) : inner_(make_simulated_scanner(world)) {}
  const ScannerInfo& info() const override { return inner_->info(); }
  Result<void> connect() override { return inner_->connect(); }
  Result<Capture> capture(const CaptureSettings& settings) override {
    const auto fault = faults.find(++captures);
    if (fault != faults.end()) return gantry::fault(fault->second, "scanner", "as the test wants");
    before_capture(captures);
    auto capture = inner_->capture(settings);
    if (blind.contains(captures))
      for (auto& point : capture->scan.points) point.setConstant(std::numeric_limits<float>::quiet_NaN());
    return capture;
  }

  std::map<int, FaultKind> faults;
  std::set<int> blind;  ///< Captures without a single point.
  std::function<void(int)> before_capture = [](int) {};
  int captures = 0;

 private:
  std::unique_ptr<Scanner> inner_;
};

/// One session: everything of a cell, new, as after the start of the program.
class Session {
 public:
  Session() {
    StrictYaml yaml = StrictYaml::load(cell().file);
    SimulationSettings settings = read_simulation(yaml.map("simulation"), cell().chain);
    settings.sensor.width = 96;
    settings.sensor.height = 60;
    static const TriangleMesh part = make_bracket();
    world = std::make_unique<SimulatedWorld>(cell().chain, settings, part, make_holder(), 9, clock);
    std::vector<std::unique_ptr<Axis>> axes;
    for (size_t i = 0; i < cell().axes.size(); ++i) {
      const AxisSettings& axis = cell().axes[i];
      axes.push_back(
          std::make_unique<Axis>(make_simulated_drive(axis.name, *world, i), axis.kind, axis.limits, clock));
    }
    motion = std::make_unique<Motion>(std::move(axes), cell().axes, MotionOptions{}, clock);
    scanner = std::make_unique<ScriptedScanner>(*world);
    EXPECT_TRUE(motion->connect() && motion->enable() && motion->home(cell().homing_order) &&
                scanner->connect());
  }

  Result<void> run(RunFolder& folder, const Plan& plan = three_views()) {
    RunObserver observer;
    observer.scan = [this](TaggedScan scan) { scans.push_back(std::move(scan)); };
    return execute_plan(cell(), plan, *motion, *scanner, folder, clock, observer);
  }

  void expect_at_rest() {
    for (size_t i = 0; i < world->axis_count(); ++i)
      EXPECT_FALSE(world->stage(i).observe(clock.now_s()).moving);
  }

  VirtualClock clock;
  std::unique_ptr<SimulatedWorld> world;
  std::unique_ptr<Motion> motion;
  std::unique_ptr<ScriptedScanner> scanner;
  std::vector<TaggedScan> scans;  ///< As handed on.
};

void expect_same(const Scan& a, const Scan& b) {
  ASSERT_EQ(a.width, b.width);
  ASSERT_EQ(a.height, b.height);
  EXPECT_EQ(std::memcmp(a.points.data(), b.points.data(), a.points.size() * sizeof(a.points[0])), 0);
}

std::vector<std::string> names(const std::vector<TaggedScan>& scans) {
  std::vector<std::string> out;
  for (const TaggedScan& scan : scans) out.push_back(scan.name);
  return out;
}

const Facts kFacts = {{"plan sha256", "aaa"}, {"cell sha256", "bbb"}};
const std::vector<std::string> kAll = {"top", "right", "left"};

TEST(Run, StoresEveryScanWithThePoseOfItsEncoders) {
  const TempFolder temp;
  RunFolder folder(temp / "run", kFacts, false);
  Session session;
  const auto done = session.run(folder);
  ASSERT_TRUE(done) << done.error().text();
  session.expect_at_rest();
  EXPECT_EQ(folder.journal().facts(), kFacts);
  EXPECT_EQ(names(session.scans), kAll);
  const auto records = folder.journal().scans();
  ASSERT_EQ(records.size(), 3u);
  uint64_t frame_id = 0;
  for (size_t k = 0; k < 3; ++k) {
    const ScanRecord& r = records[k];
    EXPECT_EQ(r.viewpoint, static_cast<int>(k));
    EXPECT_EQ(r.viewpoint_name, kAll[k]);
    EXPECT_EQ(r.file, "scans/00" + std::to_string(k + 1) + ".pcd");
    EXPECT_EQ(r.part_from_sensor.calibration_id, cell().calibration_id);
    EXPECT_EQ(r.scanner_serial, session.scanner->info().serial);
    EXPECT_EQ(r.exposure_s, 0.1);
    EXPECT_GT(r.frame_id, frame_id);
    frame_id = r.frame_id;
    EXPECT_GE(r.standstill_s, 0.2);
    EXPECT_LE(r.standstill_spread, 2);
    std::vector<double> q;
    for (size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(r.q_before[i], three_views().viewpoints[k].q[i], cell().axes[i].limits.in_position);
      q.push_back(0.5 * (r.q_before[i] + r.q_after[i]));
    }
    const UncertainPose expected = cell().chain.uncertain_part_from_sensor(q);
    EXPECT_TRUE(r.part_from_sensor.mean.isApprox(expected.mean, 1e-12));
    EXPECT_TRUE(r.part_from_sensor.shared_factor.isApprox(expected.shared_factor, 1e-12));
    EXPECT_TRUE(r.part_from_sensor.independent.isApprox(expected.independent, 1e-12));
    EXPECT_LT(translation_distance(session.world->true_part_from_sensor_at(q), r.part_from_sensor.mean), 2);

    EXPECT_GT(session.scans[k].scan.valid_count(), 200u);
    EXPECT_EQ(session.scans[k].part_from_sensor.mean.matrix(), r.part_from_sensor.mean.matrix());
    const ScanFile stored = read_scan(temp / "run" / r.file);
    expect_same(stored.scan, session.scans[k].scan);
    ASSERT_TRUE(stored.has_uncertainty) << "the file alone tells all that fusion needs";
    EXPECT_TRUE(stored.part_from_sensor.mean.isApprox(r.part_from_sensor.mean, 1e-14));
    EXPECT_EQ(stored.part_from_sensor.shared_factor, r.part_from_sensor.shared_factor);
    EXPECT_EQ(stored.part_from_sensor.independent, r.part_from_sensor.independent);
    EXPECT_EQ(stored.part_from_sensor.calibration_id, cell().calibration_id);
  }
}

TEST(Run, AFaultEndsItAndResumeContinuesWhereItStood) {
  const TempFolder temp;
  Session first;
  first.scanner->faults[2] = FaultKind::kUnreachable;
  {
    RunFolder folder(temp / "run", kFacts, false);
    const auto failed = first.run(folder);
    ASSERT_FALSE(failed);
    EXPECT_EQ(failed.error().kind, FaultKind::kUnreachable);
    EXPECT_EQ(first.scanner->captures, 2) << "only incomplete data is asked for again";
    EXPECT_EQ(folder.journal().scans().size(), 1u);
    EXPECT_EQ(names(first.scans), std::vector<std::string>{"top"});
    first.expect_at_rest();
  }
  // As if the first session had died after storing a scan and before journalling it.
  std::ofstream(temp / "run/scans/002.pcd") << "half a scan";

  Session second;
  RunFolder folder(temp / "run", kFacts, true);
  const auto done = second.run(folder);
  ASSERT_TRUE(done) << done.error().text();
  EXPECT_EQ(second.scanner->captures, 2) << "no scan is taken twice";
  EXPECT_EQ(names(second.scans), kAll) << "the scan of the first session comes first";
  expect_same(second.scans[0].scan, first.scans[0].scan);
  EXPECT_EQ(second.scans[0].part_from_sensor.mean.matrix(), first.scans[0].part_from_sensor.mean.matrix());
  EXPECT_EQ(second.scans[0].part_from_sensor.shared_factor, first.scans[0].part_from_sensor.shared_factor);
  ASSERT_EQ(folder.journal().scans().size(), 3u);
  for (size_t k = 0; k < 3; ++k)
    expect_same(read_scan(temp / "run" / folder.journal().scans()[k].file).scan, second.scans[k].scan);

  // Complete: a further resume moves and captures nothing.
  Session third;
  RunFolder again(temp / "run", kFacts, true);
  ASSERT_TRUE(third.run(again));
  EXPECT_EQ(third.scanner->captures, 0);
  EXPECT_EQ(names(third.scans), kAll);
}

TEST(Run, AnIncompleteScanIsRepeatedTwiceAndThenAFault) {
  for (const int losses : {2, 3}) {
    const TempFolder temp;
    RunFolder folder(temp / "run", kFacts, false);
    Session session;
    for (int k = 0; k < losses; ++k) session.scanner->faults[2 + k] = FaultKind::kDataLoss;
    const auto done = session.run(folder);
    if (losses == 2) {
      ASSERT_TRUE(done) << done.error().text();
      EXPECT_EQ(session.scanner->captures, 5);
      EXPECT_EQ(folder.journal().scans().size(), 3u);
    } else {
      ASSERT_FALSE(done);
      EXPECT_EQ(done.error().kind, FaultKind::kDataLoss);
      EXPECT_EQ(session.scanner->captures, 4);
      EXPECT_EQ(folder.journal().scans().size(), 1u);
    }
  }
}

TEST(Run, AScanWithoutAPointIsNoneAndLeavesARunThatCanBeResumed) {
  const TempFolder temp;
  {
    RunFolder folder(temp / "run", kFacts, false);
    Session session;
    session.scanner->blind = {2, 3, 4};
    const auto done = session.run(folder);
    ASSERT_FALSE(done);
    EXPECT_EQ(done.error().kind, FaultKind::kDataLoss);
    EXPECT_NE(done.error().text().find("not a single point"), std::string::npos) << done.error().text();
    EXPECT_EQ(folder.journal().scans().size(), 1u);
  }
  RunFolder folder(temp / "run", kFacts, true);
  Session session;
  ASSERT_TRUE(session.run(folder));
  EXPECT_EQ(folder.journal().scans().size(), 3u);
}

TEST(Run, AStageThatMovesDuringTheExposureSpoilsTheScan) {
  const TempFolder temp;
  RunFolder folder(temp / "run", kFacts, false);
  Session session;
  session.scanner->before_capture = [&](int capture) {
    if (capture == 2) session.world->stage(0).start_move(101, 50, 500, session.clock.now_s());
  };
  const auto done = session.run(folder);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, FaultKind::kNotSettled);
  EXPECT_NE(done.error().device.find("linear"), std::string::npos) << done.error().text();
  EXPECT_EQ(folder.journal().scans().size(), 1u);
}

TEST(Run, AScanFileThatIsGoneIsNamedOnResume) {
  const TempFolder temp;
  {
    RunFolder folder(temp / "run", kFacts, false);
    Session session;
    ASSERT_TRUE(session.run(folder));
  }
  std::filesystem::remove(temp / "run/scans/002.pcd");
  RunFolder folder(temp / "run", kFacts, true);
  Session session;
  try {
    (void)session.run(folder);
    ADD_FAILURE() << "accepted";
  } catch (const InputError& e) {
    EXPECT_NE(std::string(e.what()).find("scans/002.pcd"), std::string::npos) << e.what();
  }
}

/// The message with which the folder is refused; empty if it is not.
std::string refusal(const std::filesystem::path& path, const Facts& facts, bool resume) {
  try {
    RunFolder folder(path, facts, resume);
    return "";
  } catch (const InputError& e) {
    EXPECT_EQ(std::string(e.what()).rfind(path.string(), 0), 0u) << e.what();
    return e.what();
  }
}

TEST(RunFolder, ARunIsResumedOnlyWithTheSameFacts) {
  const TempFolder temp;
  EXPECT_EQ(refusal(temp / "run", kFacts, false), "");
  EXPECT_EQ(refusal(temp / "run", kFacts, true), "");
  const std::string other = refusal(temp / "run", {{"plan sha256", "ccc"}, {"cell sha256", "bbb"}}, true);
  for (const char* expected : {"plan sha256", "'aaa'", "'ccc'"})
    EXPECT_NE(other.find(expected), std::string::npos) << other;
  EXPECT_NE(refusal(temp / "run", {{"plan sha256", "aaa"}}, true).find("cell sha256"), std::string::npos)
      << "a fact that is missing now";
  Facts more = kFacts;
  more["reference sha256"] = "ddd";
  EXPECT_NE(refusal(temp / "run", more, true).find("reference sha256"), std::string::npos)
      << "a fact that is new";
}

TEST(RunFolder, AnExistingRunIsNotOverwritten) {
  const TempFolder temp;
  EXPECT_EQ(refusal(temp / "run", kFacts, false), "");
  EXPECT_NE(refusal(temp / "run", kFacts, false).find("--resume"), std::string::npos);
  std::filesystem::create_directories(temp / "other");
  EXPECT_NE(refusal(temp / "other", kFacts, true).find("no run to resume"), std::string::npos);
  EXPECT_EQ(refusal(temp / "other", kFacts, false), "") << "an empty folder is as good as none";
  std::filesystem::create_directories(temp / "full");
  std::ofstream(temp / "full/thesis.tex") << "text";
  EXPECT_NE(refusal(temp / "full", kFacts, false), "");
  EXPECT_EQ(file_text(temp / "full/thesis.tex"), "text");
  EXPECT_FALSE(std::filesystem::exists(temp / "full/journal.sqlite"));
}

TEST(RunFolder, ARunThatDiedBeforeItsFirstEntryCanBeResumed) {
  const TempFolder temp;
  std::filesystem::create_directories(temp / "run");
  { const Journal journal(temp / "run/journal.sqlite"); }
  EXPECT_EQ(refusal(temp / "run", kFacts, true), "");
  EXPECT_TRUE(std::filesystem::is_directory(temp / "run/scans"));
  EXPECT_EQ(Journal(temp / "run/journal.sqlite").facts(), kFacts);
}

TEST(RunFolder, ABrokenJournalIsRefused) {
  const TempFolder temp;
  std::filesystem::create_directories(temp / "run");
  std::ofstream(temp / "run/journal.sqlite") << "not a database" << std::string(4096, 'x');
  EXPECT_NE(refusal(temp / "run", kFacts, true), "");
}

}  // namespace
}  // namespace gantry
