// A run's journal: the tag of a scan in a sound database, or the database file itself. The first byte of
// an input chooses which.

#include <sqlite3.h>

#include "fuzz.h"
#include "gantry/acquisition/journal.h"

namespace gantry::fuzz {
namespace {

constexpr char kFile = 'F', kTag = 'T';

void write_journal(const std::filesystem::path& path) {
  Journal journal(path);
  journal.set_facts({{"calibration", "nominal"}, {"software", "gantry"}});
  journal.add_event("fault", "a cable");
  for (int i = 0; i < 2; ++i) {
    ScanRecord record;
    record.viewpoint = i;
    record.viewpoint_name = "top";
    record.file = "scans/00" + std::to_string(i) + ".pcd";
    record.q_before = record.q_after = {100.5, 0.1, -0.2};
    record.part_from_sensor.mean = pose_from_position_rpy({1, 2, 300}, {0.1, 0.2, 0.3});
    record.captured_at = "2026-01-01T00:00:00Z";
    journal.add_scan(record);
  }
}

/// Reads (`new_text` null) or replaces the tags of all scans.
std::string tag(const std::filesystem::path& path, const std::string* new_text) {
  sqlite3* db = nullptr;
  sqlite3_stmt* statement = nullptr;
  sqlite3_open(path.c_str(), &db);
  sqlite3_exec(db, "PRAGMA synchronous = OFF; PRAGMA journal_mode = MEMORY", nullptr, nullptr, nullptr);
  sqlite3_prepare_v2(db, new_text ? "UPDATE scans SET tag = ?" : "SELECT tag FROM scans", -1, &statement,
                     nullptr);
  if (new_text)
    sqlite3_bind_text(statement, 1, new_text->data(), static_cast<int>(new_text->size()), SQLITE_STATIC);
  std::string text;
  if (sqlite3_step(statement) == SQLITE_ROW)
    text = reinterpret_cast<const char*>(sqlite3_column_text(statement, 0));
  sqlite3_finalize(statement);
  sqlite3_close(db);
  return text;
}

}  // namespace

std::vector<std::string> seeds() {
  const TemporaryFolder folder;
  write_journal(folder / "journal.sqlite");
  return {kTag + tag(folder / "journal.sqlite", nullptr),
          kFile + TemporaryFolder::read(folder / "journal.sqlite")};
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static const TemporaryFolder folder;
  static const std::filesystem::path sound = folder / "sound.sqlite", broken = folder / "broken.sqlite";
  static const bool written = (fuzz::write_journal(sound), true);
  if (size == 0 || !written) return 0;
  const std::string bytes = fuzz::text_of(data + 1, size - 1);
  const bool is_tag = data[0] == fuzz::kTag;
  if (is_tag)
    fuzz::tag(sound, &bytes);
  else
    folder.write("broken.sqlite", bytes);
  std::filesystem::remove(folder / "broken.sqlite-journal");
  fuzz::value_or_input_error([&] {
    const Journal journal(is_tag ? sound : broken);
    journal.facts();
    for (const ScanRecord& record : journal.scans())
      if (!record.part_from_sensor.mean.matrix().allFinite())
        throw std::logic_error("a pose that is not finite");
  });
  return 0;
}
