#include <algorithm>
#include <fstream>

#include "bench.h"
#include "gantry/foundation/error.h"
#include "gantry/fusion/poses_file.h"
#include "markdown.h"
#include "process.h"

namespace gantry::bench {
namespace {

constexpr const char* kSection = "time-and-memory";

struct Measured {
  Spent preparation, registration;
  double memory_mb = 0;
};

std::filesystem::path scan_path(const std::filesystem::path& folder, size_t i) {
  return folder / text("scan_%02zu.raw", i);
}

/// Raw, because a file format's reader would show in the peak of memory.
void write_raw(const std::filesystem::path& path, const Scan& scan) {
  std::ofstream file(path, std::ios::binary);
  const int size[2] = {scan.width, scan.height};
  file.write(reinterpret_cast<const char*>(size), sizeof size);
  file.write(reinterpret_cast<const char*>(scan.points.data()),
             static_cast<std::streamsize>(scan.points.size() * sizeof scan.points[0]));
  file.flush();
  if (!file) throw InputError(path.string() + ": cannot be written");
}

Scan read_raw(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  int size[2] = {};
  file.read(reinterpret_cast<char*>(size), sizeof size);
  Scan scan;
  scan.width = size[0];
  scan.height = size[1];
  if (file) scan.points.resize(static_cast<size_t>(size[0]) * static_cast<size_t>(size[1]));
  file.read(reinterpret_cast<char*>(scan.points.data()),
            static_cast<std::streamsize>(scan.points.size() * sizeof scan.points[0]));
  if (!file) throw InputError(path.string() + ": cannot be read");
  return scan;
}

/// The prior is the same for all scans: 36 numbers.
void write_prior(const std::filesystem::path& path, const Matrix6d& prior) {
  std::ofstream file(path);
  file.precision(17);
  file << prior << "\n";
}

Matrix6d read_prior(const std::filesystem::path& path) {
  std::ifstream file(path);
  Matrix6d prior;
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 6; ++c) file >> prior(r, c);
  if (!file) throw InputError(path.string() + ": cannot be read");
  return prior;
}

Measured measure_in_child(const std::filesystem::path& folder, const std::string& method, int threads) {
  run_process({"/proc/self/exe", "--measure", method, "--measure-scans", folder.string(), "--threads",
               std::to_string(threads)});
  Measured m;
  std::ifstream file(folder / "measured.txt");
  file >> m.preparation.wall_s >> m.preparation.cpu_s >> m.registration.wall_s >> m.registration.cpu_s >>
      m.memory_mb;
  if (!file) throw InputError((folder / "measured.txt").string() + ": cannot be read");
  return m;
}

struct Load {
  std::string name;
  int width = 1920;  ///< Of the sensor, pixels; the height follows at 8 : 5.
  size_t views = 8;
  bool without_grid = false;
  std::vector<std::pair<std::string, int>> runs;  ///< Method and threads.
};

}  // namespace

void measure_in_this_process(const std::filesystem::path& folder, const std::string& method_name) {
  const std::unique_ptr<Method> method = make_method(method_name);
  const double before_mb = memory_mb();
  Spent preparation;
  size_t count = 0;
  for (; std::filesystem::exists(scan_path(folder, count)); ++count) {
    TaggedScan tagged;
    tagged.name = text("scan %zu", count);
    tagged.scan = read_raw(scan_path(folder, count));
    preparation += method->add(tagged);
  }
  std::vector<UncertainPose> initial;
  const Matrix6d prior = read_prior(folder / "prior.txt");
  for (const Pose& pose : read_poses(folder / "initial.txt", count)) {
    initial.emplace_back().mean = pose;
    initial.back().independent = prior;
  }
  const MethodResult result = method->run(initial);
  std::vector<Pose> found;
  for (const UncertainPose& pose : result.part_from_sensor) found.push_back(pose.mean);
  write_poses(folder / "found.txt", found);
  std::ofstream(folder / "measured.txt")
      << preparation.wall_s << ' ' << preparation.cpu_s << ' ' << result.registration.wall_s << ' '
      << result.registration.cpu_s << ' ' << peak_memory_mb() - before_mb << "\n";
}

std::string time_and_memory(Bench& bench) {
  const std::string part = bench.options.has_part("bunny") ? "bunny" : "prismatic-block";
  const std::vector<Load> loads = {
      {"8 scans",
       1920,
       8,
       false,
       {{"joint", 1}, {"joint", 2}, {"refined-pose-graph", 2}, {"open3d-gicp", 2}}},
      {"12 scans, 4.7 MP", 2752, 12, false, {{"joint", 1}, {"joint", 2}, {"open3d-gicp", 2}}},
      {"8 scans, no grid", 1920, 8, true, {{"joint", 1}, {"joint", 2}}}};
  Table table({"load", "points a scan", "method", "threads", "preparation, wall s (CPU)",
               "registration, wall s (CPU)", "peak memory MB", "dmax mm"});
  const TemporaryFolder temporary;
  const ScannedPart scanned(part, bench.options.bunny);
  for (const Load& load : loads) {
    const std::filesystem::path folder = temporary.path / load.name;
    std::filesystem::create_directories(folder);
    ScanSettings settings;
    settings.views = load.views;
    settings.without_grid = load.without_grid;
    settings.sensor.width = load.width;
    settings.sensor.height = load.width * 5 / 8;
    const ScanSet set = scanned.scan(settings);
    const std::vector<UncertainPose> initial = initial_poses(set, 3, 6, 3000);
    std::vector<Pose> poses;
    for (const UncertainPose& pose : initial) poses.push_back(pose.mean);
    for (size_t i = 0; i < set.scans.size(); ++i) write_raw(scan_path(folder, i), set.scans[i].scan);
    write_poses(folder / "initial.txt", poses);
    write_prior(folder / "prior.txt", initial[0].independent);
    for (const auto& [method, threads] : load.runs) {
      const auto& known = method_names();
      if (std::find(known.begin(), known.end(), method) == known.end()) continue;
      if (bench.options.quick && is_peer(method)) continue;
      bench.progress.stage("time and memory: " + load.name + ", " + method + text(", threads %d", threads));
      const Measured m = measure_in_child(folder, method, threads);
      RunRecord run;
      run.section = kSection;
      run.part = part;
      run.method = method;
      run.label = load.name + text(", %d threads", threads);
      run.error = pose_error(set, initial, read_poses(folder / "found.txt", set.scans.size()));
      run.preparation = m.preparation;
      run.registration = m.registration;
      table.add({load.name, text("%zuk", set.valid_points / 1000), method, text("%d", threads),
                 text("%.2f (%.2f)", m.preparation.wall_s, m.preparation.cpu_s),
                 text("%.2f (%.2f)", m.registration.wall_s, m.registration.cpu_s), text("%.0f", m.memory_mb),
                 short_number(run.error.dmax_mm)});
      bench.records.push_back(std::move(run));
    }
    std::filesystem::remove_all(folder);
  }
  return "## Time and memory\nThe " + part +
         ", sensor of 1920 x 1200 pixels (2752 x 1720 for 4.7 MP), initial poses off by [3,6]. Each line is "
         "a process of its own. "
         "Reading is not "
         "timed. Peak memory is above what the program held before the first scan, and includes the scans, "
         "which are "
         "read one at a time. Wall times mean something on a quiet machine only.\n\n" +
         table.str();
}

}  // namespace gantry::bench
