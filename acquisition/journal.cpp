#include "gantry/acquisition/journal.h"

#include <sqlite3.h>

#include <chrono>
#include <ctime>
#include <nlohmann/json.hpp>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

/// A prepared statement that is finalised with its scope.
class Statement {
 public:
  Statement(sqlite3* db, const std::string& sql, const std::filesystem::path& path) : db_(db), path_(path) {
    if (sqlite3_prepare_v2(db, sql.c_str(), -1, &statement_, nullptr) != SQLITE_OK) fail();
  }
  ~Statement() { sqlite3_finalize(statement_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(const std::string& value) {
    sqlite3_bind_text(statement_, ++bound_, value.c_str(), static_cast<int>(value.size()), SQLITE_TRANSIENT);
    return *this;
  }
  Statement& bind(int64_t value) {
    sqlite3_bind_int64(statement_, ++bound_, value);
    return *this;
  }
  bool step() {
    const int status = sqlite3_step(statement_);
    if (status == SQLITE_ROW) return true;
    if (status != SQLITE_DONE) fail();
    return false;
  }
  std::string text(int column) const {
    const unsigned char* value = sqlite3_column_text(statement_, column);
    return value ? reinterpret_cast<const char*>(value) : "";
  }
  int64_t integer(int column) const { return sqlite3_column_int64(statement_, column); }

 private:
  [[noreturn]] void fail() const { throw InputError(path_.string() + ": " + sqlite3_errmsg(db_)); }

  sqlite3* db_;
  const std::filesystem::path& path_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

template <typename Matrix>
nlohmann::json numbers(const Matrix& m) {
  nlohmann::json out = nlohmann::json::array();
  for (Eigen::Index r = 0; r < m.rows(); ++r)
    for (Eigen::Index c = 0; c < m.cols(); ++c) out.push_back(m(r, c));
  return out;
}

template <typename Matrix>
void read_numbers(const nlohmann::json& json, Matrix& m) {
  if (json.size() != static_cast<size_t>(m.size()))
    throw InputError("expected " + std::to_string(m.size()) + " numbers, found " +
                     std::to_string(json.size()));
  for (Eigen::Index r = 0; r < m.rows(); ++r)
    for (Eigen::Index c = 0; c < m.cols(); ++c)
      m(r, c) = json.at(static_cast<size_t>(r * m.cols() + c)).get<double>();
}

/// One list of six numbers for each column.
nlohmann::json columns(const SharedFactor& factor) {
  nlohmann::json out = nlohmann::json::array();
  for (const auto& column : factor.colwise()) out.push_back(numbers(column));
  return out;
}

SharedFactor read_columns(const nlohmann::json& json) {
  SharedFactor factor(6, static_cast<Eigen::Index>(json.size()));
  Vector6d column;
  for (size_t k = 0; k < json.size(); ++k) {
    read_numbers(json[k], column);
    factor.col(static_cast<Eigen::Index>(k)) = column;
  }
  return factor;
}

std::string tag_json(const ScanRecord& record) {
  return nlohmann::json{{"viewpoint_name", record.viewpoint_name},
                        {"q_before", record.q_before},
                        {"q_after", record.q_after},
                        {"standstill_s", record.standstill_s},
                        {"standstill_spread", record.standstill_spread},
                        {"part_from_sensor", numbers(record.part_from_sensor.mean.matrix())},
                        {"covariance_independent", numbers(record.part_from_sensor.independent)},
                        {"shared_factor", columns(record.part_from_sensor.shared_factor)},
                        {"frame_id", record.frame_id},
                        {"device_timestamp_ns", record.device_timestamp_ns},
                        {"exposure_s", record.exposure_s},
                        {"scanner_serial", record.scanner_serial},
                        {"calibration_id", record.part_from_sensor.calibration_id},
                        {"captured_at", record.captured_at}}
      .dump();
}

}  // namespace

std::string utc_now() {
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc{};
  gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return text;
}

Journal::Journal(const std::filesystem::path& path) : path_(path) {
  if (sqlite3_open(path.c_str(), &db_) != SQLITE_OK) {
    const std::string message = db_ ? sqlite3_errmsg(db_) : "out of memory";
    sqlite3_close(db_);
    throw InputError(path.string() + ": cannot be opened: " + message);
  }
  try {
    sqlite3_busy_timeout(db_, 5000);  // another program may be reading the journal of a run that goes on
    // Every transaction is on the disk before it counts.
    execute("PRAGMA synchronous = FULL");
    execute("CREATE TABLE IF NOT EXISTS facts (name TEXT PRIMARY KEY, value TEXT NOT NULL)");
    execute(
        "CREATE TABLE IF NOT EXISTS events (id INTEGER PRIMARY KEY, at TEXT NOT NULL, kind TEXT NOT NULL, "
        "text TEXT NOT NULL)");
    execute(
        "CREATE TABLE IF NOT EXISTS scans (viewpoint INTEGER PRIMARY KEY, file TEXT NOT NULL, tag TEXT NOT "
        "NULL)");
  } catch (...) {
    sqlite3_close(db_);
    throw;
  }
}

Journal::~Journal() {
  sqlite3_close(db_);
}

void Journal::execute(const std::string& sql) const {
  Statement(db_, sql, path_).step();
}

void Journal::set_facts(const std::map<std::string, std::string>& facts) {
  execute("BEGIN");
  for (const auto& [name, value] : facts)
    Statement(db_, "INSERT OR REPLACE INTO facts VALUES (?, ?)", path_).bind(name).bind(value).step();
  execute("COMMIT");
}

std::map<std::string, std::string> Journal::facts() const {
  Statement query(db_, "SELECT name, value FROM facts", path_);
  std::map<std::string, std::string> facts;
  while (query.step()) facts[query.text(0)] = query.text(1);
  return facts;
}

void Journal::add_event(const std::string& kind, const std::string& text) {
  Statement(db_, "INSERT INTO events (at, kind, text) VALUES (?, ?, ?)", path_)
      .bind(utc_now())
      .bind(kind)
      .bind(text)
      .step();
}

void Journal::add_scan(const ScanRecord& record) {
  Statement(db_, "INSERT INTO scans VALUES (?, ?, ?)", path_)
      .bind(static_cast<int64_t>(record.viewpoint))
      .bind(record.file)
      .bind(tag_json(record))
      .step();
}

std::vector<ScanRecord> Journal::scans() const {
  Statement query(db_, "SELECT viewpoint, file, tag FROM scans ORDER BY viewpoint", path_);
  std::vector<ScanRecord> records;
  while (query.step()) {
    ScanRecord record;
    record.viewpoint = static_cast<int>(query.integer(0));
    record.file = query.text(1);
    try {
      const nlohmann::json tag = nlohmann::json::parse(query.text(2));
      record.viewpoint_name = tag.at("viewpoint_name");
      record.q_before = tag.at("q_before").get<std::vector<double>>();
      record.q_after = tag.at("q_after").get<std::vector<double>>();
      record.standstill_s = tag.at("standstill_s");
      record.standstill_spread = tag.at("standstill_spread");
      read_numbers(tag.at("part_from_sensor"), record.part_from_sensor.mean.matrix());
      read_numbers(tag.at("covariance_independent"), record.part_from_sensor.independent);
      if (tag.contains("shared_factor")) {
        record.part_from_sensor.shared_factor = read_columns(tag.at("shared_factor"));
      } else {
        // A journal from before the factor was recorded: what the views share is not known.
        Matrix6d shared;
        read_numbers(tag.at("covariance_shared"), shared);
        record.part_from_sensor.independent += shared;
      }
      record.frame_id = tag.at("frame_id");
      record.device_timestamp_ns = tag.at("device_timestamp_ns");
      record.exposure_s = tag.at("exposure_s");
      record.scanner_serial = tag.at("scanner_serial");
      record.part_from_sensor.calibration_id = tag.at("calibration_id");
      record.captured_at = tag.at("captured_at");
    } catch (const std::exception& e) {
      throw InputError(path_.string() + ": scan of viewpoint " + std::to_string(record.viewpoint) +
                       " has an unreadable tag: " + e.what());
    }
    records.push_back(std::move(record));
  }
  return records;
}

}  // namespace gantry
