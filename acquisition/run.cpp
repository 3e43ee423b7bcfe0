#include "gantry/acquisition/run.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "gantry/foundation/error.h"
#include "gantry/geometry/scan_file.h"

namespace gantry {
namespace {

constexpr int kCaptureAttempts = 3;

std::string scan_file_name(int viewpoint) {
  char name[32];
  std::snprintf(name, sizeof name, "scans/%03d.pcd", viewpoint + 1);
  return name;
}

Result<Capture> capture_with_repeats(Scanner& scanner, const Viewpoint& view, Journal& journal) {
  CaptureSettings settings;
  settings.exposure_s = view.exposure_s;
  for (int attempt = 1;; ++attempt) {
    auto capture = scanner.capture(settings);
    if (capture && capture->scan.valid_count() == 0)
      capture = fault(FaultKind::kDataLoss, scanner.info().text(), "the scan holds not a single point");
    if (capture || capture.error().kind != FaultKind::kDataLoss || attempt == kCaptureAttempts)
      return capture;
    journal.add_event("capture repeated", "viewpoint " + view.name + ": " + capture.error().text());
  }
}

/// Moves, exposes and tags one viewpoint. The record is complete but for the file.
Result<std::pair<Scan, ScanRecord>> scan_viewpoint(const Cell& cell, const Viewpoint& view, Motion& motion,
                                                   Scanner& scanner, Journal& journal, Clock& clock,
                                                   const std::function<void(const char*)>& stage) {
  stage("moving");
  auto still = motion.move_to(view.q);
  if (!still) return tl::make_unexpected(still.error());
  const double dwell_ends_s = clock.now_s() + view.dwell_s;
  while (clock.now_s() <
         dwell_ends_s) {  // watching the axes, so that a fault or the operator is not kept waiting
    if (auto positions = motion.read_positions(); !positions) return tl::make_unexpected(positions.error());
    clock.sleep_s(std::min(0.1, dwell_ends_s - clock.now_s()));
  }
  stage("capturing");
  auto capture = capture_with_repeats(scanner, view, journal);
  if (!capture) return tl::make_unexpected(capture.error());
  auto after = motion.read_positions();
  if (!after) return tl::make_unexpected(after.error());

  ScanRecord record;
  record.viewpoint_name = view.name;
  record.q_before = still->q;
  record.q_after = *after;
  record.standstill_s = still->duration_s;
  record.standstill_spread = still->spread;
  std::vector<double> q(view.q.size());
  for (size_t i = 0; i < q.size(); ++i) {
    q[i] = 0.5 * (record.q_before[i] + record.q_after[i]);
    const Axis& axis = *motion.axes()[i];
    if (std::abs(record.q_after[i] - record.q_before[i]) > axis.limits().in_position)
      return fault(FaultKind::kNotSettled, axis.info().text(),
                   "moved during the exposure, from " + axis.format(record.q_before[i]) + " to " +
                       axis.format(record.q_after[i]));
  }
  record.part_from_sensor = cell.chain.uncertain_part_from_sensor(q);
  record.part_from_sensor.calibration_id = cell.calibration_id;
  record.frame_id = capture->frame_id;
  record.device_timestamp_ns = capture->device_timestamp_ns;
  record.exposure_s = capture->exposure_s;
  record.scanner_serial = scanner.info().serial;
  record.captured_at = utc_now();
  return std::pair{std::move(capture->scan), std::move(record)};
}

/// Throws InputError for the first fact that differs or that only one of the sessions has.
void require_equal(const std::filesystem::path& run, const std::map<std::string, std::string>& now,
                   const std::map<std::string, std::string>& recorded) {
  const auto text = [](const std::map<std::string, std::string>& facts, const std::string& name) {
    const auto found = facts.find(name);
    return found == facts.end() ? std::string("absent") : "'" + found->second + "'";
  };
  std::map<std::string, std::string> all = now;
  all.insert(recorded.begin(), recorded.end());
  for (const auto& [name, unused] : all) {
    if (text(now, name) != text(recorded, name))
      throw InputError(run.string() + ": cannot be resumed: " + name + " is " + text(now, name) +
                       " now but was " + text(recorded, name) + " when the run began");
  }
}

}  // namespace

RunFolder::RunFolder(const std::filesystem::path& path, const std::map<std::string, std::string>& facts,
                     bool resume)
    : path_(path) {
  const std::filesystem::path journal = path / "journal.sqlite";
  const bool exists = std::filesystem::exists(journal);
  if (resume && !exists)
    throw InputError(path.string() + ": there is no run to resume here (no journal.sqlite)");
  if (!resume && exists)
    throw InputError(path.string() +
                     ": holds a run already; resume it with --resume or choose another folder");
  if (!resume && std::filesystem::exists(path) &&
      !(std::filesystem::is_directory(path) && std::filesystem::is_empty(path)))
    throw InputError(path.string() + ": exists and is not an empty folder");
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw InputError(path.string() + ": cannot be created: " + error.message());
  // In this order, so that a run that dies at any instant from here on leaves a folder that can be resumed.
  journal_ = std::make_unique<Journal>(journal);
  const auto recorded = journal_->facts();
  if (recorded.empty())
    journal_->set_facts(facts);
  else
    require_equal(path, facts, recorded);
  std::filesystem::create_directories(path / "scans", error);
  if (error) throw InputError((path / "scans").string() + ": cannot be created: " + error.message());
  journal_->add_event(resume ? "resumed" : "started", "");
}

Result<void> execute_plan(const Cell& cell, const Plan& plan, Motion& motion, Scanner& scanner,
                          RunFolder& folder, Clock& clock, const RunObserver& observer) {
  Journal& journal = folder.journal();
  std::set<int> done;
  for (const ScanRecord& record : journal.scans()) {
    done.insert(record.viewpoint);
    TaggedScan tagged{record.viewpoint_name, read_scan(folder.path() / record.file).scan,
                      record.part_from_sensor};
    observer.scan(std::move(tagged));
  }
  const size_t n = plan.viewpoints.size();
  for (size_t k = 0; k < n; ++k) {
    if (done.contains(static_cast<int>(k))) continue;
    const Viewpoint& view = plan.viewpoints[k];
    journal.add_event("viewpoint", view.name);
    auto scanned = scan_viewpoint(cell, view, motion, scanner, journal, clock,
                                  [&](const char* stage) { observer.stage(stage, k, n); });
    if (!scanned) {
      motion.stop_all("stopped because of " + scanned.error().device);
      journal.add_event("fault", scanned.error().text());
      return tl::make_unexpected(scanned.error());
    }
    auto& [scan, record] = *scanned;
    record.viewpoint = static_cast<int>(k);
    record.file = scan_file_name(record.viewpoint);
    observer.stage("storing", k, n);
    write_scan(folder.path() / record.file, scan, record.part_from_sensor);
    journal.add_scan(record);
    observer.scan(TaggedScan{view.name, std::move(scan), record.part_from_sensor});
  }
  journal.add_event("scanned", std::to_string(n) + " viewpoints");
  return {};
}

}  // namespace gantry
