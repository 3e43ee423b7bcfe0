#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "gantry/geometry/pose.h"

struct sqlite3;

namespace gantry {

/// Everything that is recorded with one scan. Written only after the scan's file is complete and synced.
struct ScanRecord {
  int viewpoint = 0;  ///< Index in the plan, from 0.
  std::string viewpoint_name;
  std::string file;                       ///< Relative to the run folder: "scans/001.pcd".
  std::vector<double> q_before, q_after;  ///< Encoder positions before and after exposure, mm or rad.
  double standstill_s = 0;       ///< How long the axes were watched to stand still before exposure ...
  double standstill_spread = 0;  ///< ... and their largest range, in units of the in-position band.
  UncertainPose part_from_sensor;  ///< With the calibration's id.
  uint64_t frame_id = 0;
  uint64_t device_timestamp_ns = 0;
  double exposure_s = 0;
  std::string scanner_serial;
  std::string captured_at;  ///< ISO 8601, UTC.
};

/// The journal of a run: one SQLite file, every entry synced to disk before the call returns, so that
/// a run can be resumed after the process or the power died at any instant. Throws InputError when the
/// file cannot be opened, written or understood.
class Journal {
 public:
  /// Opens or creates.
  explicit Journal(const std::filesystem::path& path);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  /// Facts of the whole run: hashes of the files it rests on, versions, names.
  void set_facts(const std::map<std::string, std::string>& facts);
  std::map<std::string, std::string> facts() const;

  void add_event(const std::string& kind, const std::string& text);
  void add_scan(const ScanRecord& record);
  std::vector<ScanRecord> scans() const;

 private:
  void execute(const std::string& sql) const;
  sqlite3* db_ = nullptr;
  std::filesystem::path path_;
};

/// Now, as ISO 8601 in UTC.
std::string utc_now();

}  // namespace gantry
