#include "gantry/acquisition/journal.h"

#include <gtest/gtest.h>
#include <sqlite3.h>

#include <nlohmann/json.hpp>
#include <random>

#include "acquisition/edited_file.h"
#include "foundation/expect_input_error.h"

namespace gantry {
namespace {

ScanRecord record_of(int viewpoint) {
  std::mt19937_64 random(static_cast<uint64_t>(viewpoint) + 1);
  std::normal_distribution<double> gauss;
  ScanRecord r;
  r.viewpoint = viewpoint;
  r.viewpoint_name = "view 'x\" " + std::to_string(viewpoint);
  r.file = "scans/00" + std::to_string(viewpoint) + ".pcd";
  for (int i = 0; i < 3; ++i) {
    r.q_before.push_back(gauss(random));
    r.q_after.push_back(gauss(random));
  }
  r.standstill_s = 0.21;
  r.standstill_spread = 1.0 / 3;
  r.part_from_sensor.mean = pose_from_position_rpy({gauss(random), 2, 1e-17}, {0.1, gauss(random), 3});
  for (int i = 0; i < 36; ++i) {
    r.part_from_sensor.independent(i) = 1e-9 * gauss(random);
  }
  r.part_from_sensor.shared_factor = SharedFactor::NullaryExpr(6, 5, [&] { return 1e-3 * gauss(random); });
  r.part_from_sensor.calibration_id = "nominal";
  r.frame_id = 0xFFFFFFFFFFFFFFFFull;
  r.device_timestamp_ns = 1234567890123456789ull;
  r.exposure_s = 0.1;
  r.scanner_serial = "1-2";
  r.captured_at = "2026-01-02T03:04:05Z";
  return r;
}

void expect_equal(const ScanRecord& a, const ScanRecord& b) {
  EXPECT_EQ(a.viewpoint, b.viewpoint);
  EXPECT_EQ(a.viewpoint_name, b.viewpoint_name);
  EXPECT_EQ(a.file, b.file);
  EXPECT_EQ(a.q_before, b.q_before);
  EXPECT_EQ(a.q_after, b.q_after);
  EXPECT_EQ(a.standstill_s, b.standstill_s);
  EXPECT_EQ(a.standstill_spread, b.standstill_spread);
  EXPECT_EQ(a.part_from_sensor.mean.matrix(), b.part_from_sensor.mean.matrix());
  EXPECT_EQ(a.part_from_sensor.shared_factor, b.part_from_sensor.shared_factor);
  EXPECT_EQ(a.part_from_sensor.independent, b.part_from_sensor.independent);
  EXPECT_EQ(a.frame_id, b.frame_id);
  EXPECT_EQ(a.device_timestamp_ns, b.device_timestamp_ns);
  EXPECT_EQ(a.exposure_s, b.exposure_s);
  EXPECT_EQ(a.scanner_serial, b.scanner_serial);
  EXPECT_EQ(a.part_from_sensor.calibration_id, b.part_from_sensor.calibration_id);
  EXPECT_EQ(a.captured_at, b.captured_at);
}

TEST(Journal, ReturnsEveryBitOfWhatWasRecorded) {
  const TempFolder folder;
  {
    Journal journal(folder / "journal.sqlite");
    EXPECT_TRUE(journal.scans().empty());
    EXPECT_TRUE(journal.facts().empty());
    journal.set_facts({{"plan", "abc'); DROP TABLE scans; --"}, {"cell", "1"}});
    journal.set_facts({{"cell", "2"}});
    for (const int viewpoint : {2, 0, 1}) journal.add_scan(record_of(viewpoint));
    journal.add_event("fault", "text");
  }
  Journal journal(folder / "journal.sqlite");
  EXPECT_EQ(journal.facts(),
            (std::map<std::string, std::string>{{"plan", "abc'); DROP TABLE scans; --"}, {"cell", "2"}}));
  const auto scans = journal.scans();
  ASSERT_EQ(scans.size(), 3u);
  for (int k = 0; k < 3; ++k) expect_equal(scans[static_cast<size_t>(k)], record_of(k));
}

/// Puts `tag` in the place of the only scan's tag.
void rewrite_tag(const std::filesystem::path& journal, const nlohmann::json& tag) {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(journal.c_str(), &db), SQLITE_OK);
  std::string text = tag.dump();
  char* statement = sqlite3_mprintf("UPDATE scans SET tag = %Q", text.c_str());
  EXPECT_EQ(sqlite3_exec(db, statement, nullptr, nullptr, nullptr), SQLITE_OK);
  sqlite3_free(statement);
  sqlite3_close(db);
}

nlohmann::json tag_in(const std::filesystem::path& journal) {
  sqlite3* db = nullptr;
  EXPECT_EQ(sqlite3_open(journal.c_str(), &db), SQLITE_OK);
  std::string text;
  const auto keep = [](void* into, int, char** values, char**) {
    *static_cast<std::string*>(into) = values[0];
    return 0;
  };
  EXPECT_EQ(sqlite3_exec(db, "SELECT tag FROM scans", keep, &text, nullptr), SQLITE_OK);
  sqlite3_close(db);
  return nlohmann::json::parse(text);
}

TEST(Journal, OfAnOldRunTheSharedPartCountsAsIndependent) {
  const TempFolder folder;
  const std::filesystem::path path = folder / "journal.sqlite";
  const ScanRecord record = record_of(0);
  Journal(path).add_scan(record);
  nlohmann::json tag = tag_in(path);
  tag.erase("shared_factor");
  tag["covariance_shared"] = std::vector<double>(36, 0.25);
  rewrite_tag(path, tag);
  const UncertainPose read = Journal(path).scans().at(0).part_from_sensor;
  EXPECT_EQ(read.shared_factor.cols(), 0);
  EXPECT_EQ(read.independent, record.part_from_sensor.independent + Matrix6d::Constant(0.25));
}

TEST(Journal, AMutilatedFactorIsRefused) {
  const TempFolder folder;
  const std::filesystem::path path = folder / "journal.sqlite";
  Journal(path).add_scan(record_of(0));
  const nlohmann::json tag = tag_in(path);
  const auto refused = [&](const nlohmann::json& factor, const std::string& complaint) {
    nlohmann::json wrong = tag;
    wrong["shared_factor"] = factor;
    rewrite_tag(path, wrong);
    expect_input_error([&] { Journal(path).scans(); }, {path.string(), "viewpoint 0", complaint});
  };
  refused({{1, 2, 3, 4, 5, 6}, {1, 2, 3, 4, 5}}, "expected 6 numbers, found 5");
  refused({1, 2, 3, 4, 5, 6}, "expected 6 numbers, found 1");
  refused({{1, 2, "x", 4, 5, 6}}, "must be number");
}

TEST(Journal, AnEntryIsOnDiskWhenTheCallReturns) {
  const TempFolder folder;
  Journal journal(folder / "journal.sqlite");
  for (int k = 0; k < 3; ++k) {
    journal.add_scan(record_of(k));
    // As another process sees it, while the first one has not closed anything.
    EXPECT_EQ(Journal(folder / "journal.sqlite").scans().size(), static_cast<size_t>(k) + 1);
  }
}

TEST(Journal, AViewpointIsNeverCountedTwice) {
  const TempFolder folder;
  Journal journal(folder / "journal.sqlite");
  journal.add_scan(record_of(1));
  EXPECT_THROW(journal.add_scan(record_of(1)), InputError);
  EXPECT_EQ(journal.scans().size(), 1u);
}

TEST(Journal, ABrokenFileIsAnInputErrorThatNamesIt) {
  const TempFolder folder;
  const std::filesystem::path path = folder / "journal.sqlite";
  {
    Journal journal(path);
    journal.add_scan(record_of(0));
  }
  const std::string whole = file_text(path);
  std::string holed = whole;
  std::fill(holed.begin() + 100, holed.end(), '\x5A');
  std::string wrong_tag = whole;
  const size_t at = wrong_tag.find("\"q_before\"");
  ASSERT_NE(at, std::string::npos);
  wrong_tag.replace(at, 10, "\"q_befOOO\"");
  for (const std::string& bytes :
       {std::string("this is not a database, it is a letter\n") + std::string(5000, 'x'),
        whole.substr(0, whole.size() / 2), holed, wrong_tag}) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
    try {
      Journal(path).scans();
      ADD_FAILURE() << "accepted";
    } catch (const InputError& e) {
      EXPECT_EQ(std::string(e.what()).rfind(path.string(), 0), 0u) << e.what();
    }
  }
  EXPECT_THROW(Journal(folder / "no such folder/journal.sqlite"), InputError);
}

}  // namespace
}  // namespace gantry
