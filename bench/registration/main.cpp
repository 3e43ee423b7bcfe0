// Benchmarks of registration: one run measures everything on the same scans and writes the page that
// docs/results/registration.md shows.

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <thread>

#include "app.h"
#include "bench.h"
#include "gantry/foundation/error.h"
#include "markdown.h"
#ifdef GANTRY_BENCH_OPEN3D
#include "open3d_multiway.h"
#endif

namespace {

using namespace gantry;
using namespace gantry::bench;

struct Section {
  std::string name;
  std::string (*run)(Bench&);
};
const std::vector<Section> kSections = {{"accuracy", accuracy_by_band},
                                        {"robustness", robustness},
                                        {"covariance", covariance_coverage},
                                        {"time-and-memory", time_and_memory},
                                        {"parameters", parameter_study}};

Band parse_band(const std::string& word) {
  Band band;
  char end = 0;
  if (std::sscanf(word.c_str(), "%lf-%lf%c", &band.from, &band.to, &end) != 2 || band.from < 0 ||
      band.to < band.from)
    throw InputError("--bands: \"" + word + "\" is not FROM-TO, such as 1-3");
  return band;
}

/// The command as typed, without where the bunny lies and where results go: those are the machine's affair.
std::string command_line(int argc, char** argv) {
  std::string out = "scripts/bench registration";
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.starts_with("--bunny=") || word.starts_with("--out=")) continue;
    if (word == "--bunny" || word == "--out") {
      ++i;
      continue;
    }
    out += " " + word;
  }
  return out;
}

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

std::string introduction(const BenchOptions& o, const std::string& command) {
  std::string out = "# Registration, measured\n\n";
  if (o.quick) out += "**A quick run: few draws, to see that the benchmark works. Not for quoting.**\n\n";
  out += "Made by `" + command +
         "` in one run; every single registration is in [registration.csv](registration.csv).\n\n";
  out +=
      "- **Scans**: simulated, structured light, 1920 x 1200 pixels, 38.7 x 24.75 degrees, from Poisson-disc "
      "directions "
      "at 450 to 550 mm; noise 0.05 mm at 500 mm, growing with the distance squared and at grazing "
      "incidence; mixed "
      "pixels at depth steps, dropouts, shadows of the projector. The bunny is 150 mm tall.\n"
      "- **Initial poses**: turned about the part's centre and shifted, angle (degrees) and length (mm) each "
      "uniform in "
      "the band, axes uniform on the sphere. All methods are told the same: 15 mm and 15 degrees, one "
      "sigma.\n"
      "- **Errors**: the first scan is the gauge. *Element difference*: the paper's figure, mean of the "
      "absolute "
      "differences of all 16 elements of the true and the estimated correction matrix, mean over the other "
      "scans. "
      "*dmax*: the largest displacement of any measured point of any scan. Solved: dmax below 1 mm.\n";
  out += text("- **Machine**: %s, %u threads%s. Gantry " GANTRY_VERSION, processor().c_str(),
              std::thread::hardware_concurrency(), o.threads ? text(" (%d used)", o.threads).c_str() : "");
#ifdef GANTRY_BENCH_OPEN3D
  out += ", Open3D " GANTRY_BENCH_OPEN3D
         " (multiway registration by its tutorial's recipe: voxel 1 mm, 15 then 1.5 mm; "
         "the narrow variant 4 then 2 mm; all pairs; normals of 30 neighbours; global optimisation with its "
         "defaults)";
#else
  out += ", without Open3D (not installed when this was built: its rows are missing)";
#endif
  return out + ".\n\n";
}

void run_sections(Bench& bench, const std::string& command) {
  const BenchOptions& o = bench.options;
  std::filesystem::create_directories(o.out);
  const Stopwatch all;
  std::string body;
  for (const Section& section : kSections) {
    if (std::find(o.sections.begin(), o.sections.end(), section.name) == o.sections.end()) continue;
    const Stopwatch watch;
    body += section.run(bench);
    body += text("*This section took %.1f minutes of CPU time.*\n\n", watch.spent().cpu_s / 60);
    // After every section, so that a run that is cut short leaves what it has.
    std::ofstream page(o.out / "registration.md");
    page << introduction(o, command) << body
         << text("*In all %.1f minutes of CPU time, rendering included.*\n", all.spent().cpu_s / 60);
    page.flush();
    if (!page) throw InputError((o.out / "registration.md").string() + ": cannot be written");
    write_csv(o.out / "registration.csv", bench.records);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Measures registration: accuracy by initial error, robustness, covariance, time and memory, "
      "parameters; writes "
      "registration.md, registration.csv and pictures.\n"
      "Example: gantry-bench-registration --bunny bun_zipper.ply --out docs/results\n"
      "Example: gantry-bench-registration --sections accuracy --parts bracket --methods joint --draws 3 "
      "--out /tmp/try",
      "gantry-bench-registration"};
  CommonOptions common;
  add_common_options(app, common);
  BenchOptions o;
  o.parts = {"bunny", "bracket", "slim-lever", "prismatic-block", "turned-flat"};
  o.methods = method_names();
  for (const Section& section : kSections) o.sections.push_back(section.name);
  std::vector<std::string> bands = {"0-1", "1-3", "3-6", "6-10", "10-15", "15-20", "20-30"};
  std::string measure;
  std::filesystem::path measure_scans;
  o.out = "docs/results";
  app.add_option("--parts", o.parts, "Of the accuracy section")
      ->delimiter(',')
      ->check(CLI::IsMember(part_names()));
  auto* bands_given = app.add_option("--bands", bands, "Initial errors, FROM-TO in degrees and mm")
                          ->delimiter(',')
                          ->capture_default_str();
  auto* draws = app.add_option("--draws", o.draws, "Initial poses in each band; slower methods do fewer")
                    ->check(CLI::Range(1, 1000))
                    ->capture_default_str();
  app.add_option("--view-sets", o.view_sets, "Choices of viewpoints that the draws are dealt over")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  auto* coverage = app.add_option("--coverage-runs", o.coverage_runs, "Runs a part of the covariance section")
                       ->check(CLI::Range(1, 100000))
                       ->capture_default_str();
  auto* methods_given = app.add_option("--methods", o.methods, "Of the accuracy section")
                            ->delimiter(',')
                            ->check(CLI::IsMember(method_names()));
  app.add_option("--sections", o.sections, "What to measure")->delimiter(',')->check(CLI::IsMember([] {
    std::vector<std::string> names;
    for (const Section& section : kSections) names.push_back(section.name);
    return names;
  }()));
  app.add_option("--out", o.out, "Folder of the page")->capture_default_str();
  app.add_option("--bunny", o.bunny,
                 "Mesh of the Stanford bunny (bun_zipper.ply); without it its rows are skipped")
      ->envname("GANTRY_BUNNY")
      ->check(CLI::ExistingFile);
  app.add_flag("--quick", o.quick, "Two draws of two bands, few runs, no peers: to see that it works")
      ->excludes(draws)
      ->excludes(coverage);
  app.add_option("--measure", measure)->group("");
  app.add_option("--measure-scans", measure_scans)->group("");
  return run_app(app, argc, argv, common, [&] {
    o.threads = common.threads;
#ifdef GANTRY_BENCH_OPEN3D
    set_open3d_threads(o.threads);
#endif
    if (!measure.empty()) {
      measure_in_this_process(measure_scans, measure);
      return ExitCode::kPass;
    }
    if (o.quick) {
      o.draws = 2;
      o.view_sets = 1;
      o.coverage_runs = 5;
      if (bands_given->count() == 0) bands = {"1-3", "10-15"};
      if (methods_given->count() == 0) std::erase_if(o.methods, is_peer);
    }
    for (const std::string& word : bands) o.bands.push_back(parse_band(word));
    Bench bench{o, {}, Progress(stdout_is_terminal())};
    run_sections(bench, command_line(argc, argv));
    return ExitCode::kPass;
  });
}
