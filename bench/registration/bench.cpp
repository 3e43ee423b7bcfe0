#include "bench.h"

#include <algorithm>
#include <fstream>

#include "gantry/foundation/error.h"
#include "markdown.h"

namespace gantry::bench {
namespace {

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const size_t half = values.size() / 2;
  return values.size() % 2 ? values[half] : (values[half - 1] + values[half]) / 2;
}

/// A field of a CSV file: reasons hold commas and may hold quotes.
std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}

}  // namespace

std::string Band::name() const {
  return text("[%g,%g]", from, to);
}

Tally tally(const std::vector<const RunRecord*>& runs) {
  Tally t;
  std::vector<double> mae, dmax, preparation_wall, preparation_cpu, wall, cpu;
  for (const RunRecord* run : runs) {
    const bool good = run->error.success(), objected = !run->reason.empty();
    ++t.runs;
    t.successes += good;
    t.undecided += objected;
    t.false_success += !good && !objected;
    t.needless_undecided += good && objected;
    mae.push_back(run->error.mae16);
    dmax.push_back(run->error.dmax_mm);
    preparation_wall.push_back(run->preparation.wall_s);
    preparation_cpu.push_back(run->preparation.cpu_s);
    wall.push_back(run->registration.wall_s);
    cpu.push_back(run->registration.cpu_s);
  }
  if (runs.empty()) return t;
  t.mae16_worst = *std::max_element(mae.begin(), mae.end());
  t.dmax_worst_mm = *std::max_element(dmax.begin(), dmax.end());
  t.mae16_median = median(std::move(mae));
  t.dmax_median_mm = median(std::move(dmax));
  t.preparation = {median(std::move(preparation_wall)), median(std::move(preparation_cpu))};
  t.registration = {median(std::move(wall)), median(std::move(cpu))};
  return t;
}

std::vector<const RunRecord*> Bench::select(const std::string& section, const std::string& part,
                                            const std::string& method, const std::string& label) const {
  std::vector<const RunRecord*> found;
  for (const RunRecord& run : records)
    if (run.section == section && (part.empty() || run.part == part) && run.method == method &&
        (label.empty() || run.label == label))
      found.push_back(&run);
  return found;
}

PreparedMethod prepare(std::unique_ptr<Method> method, const ScanSet& set) {
  PreparedMethod prepared{std::move(method), {}};
  for (const TaggedScan& scan : set.scans) prepared.preparation += prepared.method->add(scan);
  return prepared;
}

RunRecord judged_run(PreparedMethod& prepared, const ScanSet& set,
                     const std::vector<UncertainPose>& initial) {
  MethodResult result = prepared.method->run(initial);
  std::vector<Pose> found;
  for (const UncertainPose& pose : result.part_from_sensor) found.push_back(pose.mean);
  RunRecord record;
  record.error = pose_error(set, initial, found);
  record.reason = std::move(result.reason);
  record.preparation = prepared.preparation;
  record.registration = result.registration;
  record.found = std::move(result.part_from_sensor);
  return record;
}

void write_csv(const std::filesystem::path& path, const std::vector<RunRecord>& records) {
  std::ofstream file(path);
  file << "section,part,method,label,draw,mae16,dmax_mm,success,reason,preparation_wall_s,preparation_cpu_s,"
          "registration_wall_s,registration_cpu_s\n";
  for (const RunRecord& r : records)
    file << r.section << ',' << r.part << ',' << r.method << ',' << quoted(r.label) << ',' << r.draw << ','
         << text("%.6g,%.6g,%d,", r.error.mae16, r.error.dmax_mm, r.error.success()) << quoted(r.reason)
         << text(",%.4f,%.4f,%.4f,%.4f\n", r.preparation.wall_s, r.preparation.cpu_s, r.registration.wall_s,
                 r.registration.cpu_s);
  file.flush();
  if (!file) throw InputError(path.string() + ": cannot be written");
}

}  // namespace gantry::bench
