// How long closest points take: of clouds on meshes, signed, and in other clouds; beside Embree, nanoflann
// and, where it is installed, CloudCompare, in turn, each in a process of its own. Writes the page that
// docs/results/closest.md shows.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "app.h"
#include "gantry/geometry/mesh_file.h"
#include "gantry/geometry/point_cloud_file.h"
#include "gantry/sim/bracket.h"
#include "gantry/sim/scan_set.h"
#include "load.h"
#include "markdown.h"
#include "methods.h"
#include "process.h"
#include "progress.h"

namespace {

using namespace gantry;
using namespace gantry::bench;

struct Options {
  std::filesystem::path bunny, out = "docs/results";
  size_t rounds = 3;
  bool quick = false;
};

struct Measured {
  Spent spent;
  double memory_mb = 0;
};

/// Medians over the rounds, each by itself.
struct Series {
  std::vector<Measured> rounds;
  double median(double (*value)(const Measured&)) const {
    std::vector<double> values;
    for (const Measured& m : rounds) values.push_back(value(m));
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
  }
  double cpu_s() const {
    return median([](const Measured& m) { return m.spent.cpu_s; });
  }
  double wall_s() const {
    return median([](const Measured& m) { return m.spent.wall_s; });
  }
  double memory_mb() const {
    return median([](const Measured& m) { return m.memory_mb; });
  }
};

/// In the process that is measured. What is read is not counted, neither as time nor as memory.
void measure_here(const std::string& method, const std::filesystem::path& folder) {
  const PointCloud cloud = read_raw_cloud(folder / "points.raw");
  const bool to_mesh = method == "gantry" || method == "embree";
  TriangleMesh mesh;
  PointCloud others;
  if (to_mesh)
    mesh = read_raw_mesh(folder / "mesh.raw");
  else
    others = read_raw_cloud(folder / "others.raw");
  const double before_mb = memory_mb();
  const Stopwatch watch;
  const std::vector<float> distances = method == "gantry"         ? by_gantry(cloud, std::move(mesh))
                                       : method == "embree"       ? by_embree(cloud, mesh)
                                       : method == "gantry-cloud" ? nearest_by_gantry(cloud, others)
                                                                  : nearest_by_nanoflann(cloud, others);
  const Spent spent = watch.spent();
  write_raw(folder / "distances.raw", distances);
  std::ofstream file(folder / "measured.txt");
  file << spent.wall_s << ' ' << spent.cpu_s << ' ' << peak_memory_mb() - before_mb << '\n';
}

class Bench {
 public:
  explicit Bench(const Options& options) : options_(options), progress_(stdout_is_terminal()) {}

  std::string page() {
    TriangleMesh mesh = part();
    std::vector<TriangleMesh> meshes;
    for (int level = 0; level < (options_.quick ? 1 : 3); ++level) {
      meshes.push_back(mesh);
      mesh = subdivided(mesh);
    }
    std::string body = "## Signed distances to a mesh\n";
    Table table({"points", "triangles", "method", "threads", "CPU s", "wall s", "memory MB",
                 "CloudCompare's CPU / this"});
    for (const size_t points : sizes())
      for (const TriangleMesh& to : meshes) to_mesh(points, to, table);
    body += table.str();
    Table clouds({"points to points", "method", "threads", "CPU s", "wall s", "memory MB"});
    for (const size_t points : sizes()) to_cloud(points, meshes[0], clouds);
    return introduction() + body + "\n## Distances to the nearest of other points\n" + clouds.str() + "\n";
  }

 private:
  std::vector<size_t> sizes() const {
    return options_.quick ? std::vector<size_t>{100'000} : std::vector<size_t>{1'000'000, 5'000'000};
  }

  TriangleMesh part() const {
    if (!options_.bunny.empty()) return scaled_to_height(read_mesh(options_.bunny, 1000), 150);
    TriangleMesh mesh = make_bracket();
    while (mesh.triangles.size() < 50'000) mesh = subdivided(mesh);
    return mesh;
  }

  std::string introduction() const {
    std::string out = "# Closest points, measured\n\n";
    if (options_.quick) out += "**A quick run, to see that the benchmark works. Not for quoting.**\n\n";
    out += text(
        "Made by `scripts/bench closest`. %s, cut in four once and twice; points within 1 mm of it, in no "
        "order. "
        "Every "
        "line is %s, in a process of its own, the methods in turn. Everything from "
        "points and triangles in memory to distances is counted, reading is not. Of CloudCompare, which "
        "reads "
        "files, that is a run with the command less a run that only reads, with `-MAX_TCOUNT 1`; differences "
        "of CPU time are good to about 0.1 s.\n\n",
        options_.bunny.empty() ? "The bracket" : "The Stanford bunny, 150 mm tall",
        options_.rounds == 1 ? "one run" : text("the median of %zu runs", options_.rounds).c_str());
    if (!cloudcompare_) out += "CloudCompare is not installed here: its lines are missing.\n\n";
    return out;
  }

  Measured run(const std::string& method, int threads) {
    run_process({"/proc/self/exe", "--measure", method, "--folder", folder_.path.string(), "--threads",
                 std::to_string(threads)});
    std::ifstream file(folder_.path / "measured.txt");
    Measured m;
    file >> m.spent.wall_s >> m.spent.cpu_s >> m.memory_mb;
    if (!file) throw InputError(method + ": what was measured cannot be read");
    // All measure the same thing, or they are not worth comparing.
    std::vector<float> distances = read_raw_distances(folder_.path / "distances.raw");
    for (float& d : distances) d = std::abs(d);
    if (expected_.empty()) expected_ = distances;
    for (size_t i = 0; i < expected_.size(); ++i)
      if (!(std::abs(distances[i] - expected_[i]) < 1e-5f))
        throw InputError(text("%s: point %zu is %.6f mm away, by another method %.6f mm", method.c_str(), i,
                              distances[i], expected_[i]));
    return m;
  }

  Spent cloudcompare(const std::vector<std::string>& files, const std::string& command) {
    const auto with = [&](bool command_too) {
      std::vector<std::string> words = {"CloudCompare", "-SILENT", "-AUTO_SAVE", "OFF"};
      for (const std::string& file : files) {
        words.push_back("-O");
        words.push_back((folder_.path / file).string());
      }
      if (command_too) words.insert(words.end(), {command, "-MAX_TCOUNT", "1"});
      return run_process(words, {"QT_QPA_PLATFORM=offscreen", "QT_LOGGING_RULES=*.warning=false"});
    };
    const Spent reading = with(false), all = with(true);
    return {all.wall_s - reading.wall_s, all.cpu_s - reading.cpu_s};
  }

  void to_mesh(size_t points, const TriangleMesh& mesh, Table& table) {
    const std::string name = text("%zuk on %zuk", points / 1000, mesh.triangles.size() / 1000);
    const PointCloud cloud = points_near(mesh, points);
    write_raw(folder_.path / "points.raw", cloud);
    write_raw(folder_.path / "mesh.raw", mesh);
    if (cloudcompare_) {
      write_point_cloud(folder_.path / "points.ply", cloud);
      write_mesh(folder_.path / "mesh.ply", mesh);
    }
    expected_.clear();
    Series one, two, embree, peer;
    for (size_t round = 0; round < options_.rounds; ++round) {
      progress_.stage(name + text(", round %zu", round + 1));
      one.rounds.push_back(run("gantry", 1));
      embree.rounds.push_back(run("embree", 1));
      two.rounds.push_back(run("gantry", 2));
      if (cloudcompare_) peer.rounds.push_back({cloudcompare({"points.ply", "mesh.ply"}, "-C2M_DIST"), 0});
    }
    const auto line = [&](const char* method, const char* threads, const Series& s) {
      table.add({text("%zuk", points / 1000), text("%zuk", mesh.triangles.size() / 1000), method, threads,
                 text("%.2f", s.cpu_s()), text("%.2f", s.wall_s()),
                 s.memory_mb() > 0 ? text("%.0f", s.memory_mb()) : "–",
                 cloudcompare_ ? text("%.1f", peer.cpu_s() / s.cpu_s()) : "–"});
    };
    line("gantry", "1", one);
    line("gantry", "2", two);
    line("Embree", "1", embree);
    if (cloudcompare_) line("CloudCompare", "1", peer);
  }

  void to_cloud(size_t points, const TriangleMesh& mesh, Table& table) {
    const std::string name = text("%zuk to %zuk", points / 1000, points / 1000);
    const PointCloud cloud = points_near(mesh, points), others = points_near(mesh, points, 2);
    write_raw(folder_.path / "points.raw", cloud);
    write_raw(folder_.path / "others.raw", others);
    if (cloudcompare_) {
      write_point_cloud(folder_.path / "points.ply", cloud);
      write_point_cloud(folder_.path / "others.ply", others);
    }
    expected_.clear();
    Series one, two, nanoflann, peer;
    for (size_t round = 0; round < options_.rounds; ++round) {
      progress_.stage(name + text(", round %zu", round + 1));
      one.rounds.push_back(run("gantry-cloud", 1));
      nanoflann.rounds.push_back(run("nanoflann", 1));
      two.rounds.push_back(run("gantry-cloud", 2));
      if (cloudcompare_) peer.rounds.push_back({cloudcompare({"points.ply", "others.ply"}, "-C2C_DIST"), 0});
    }
    const auto line = [&](const char* method, const char* threads, const Series& s) {
      table.add({name, method, threads, text("%.2f", s.cpu_s()), text("%.2f", s.wall_s()),
                 s.memory_mb() > 0 ? text("%.0f", s.memory_mb()) : "–"});
    };
    line("gantry (nanoflann, leaves of 16)", "1", one);
    line("gantry (nanoflann, leaves of 16)", "2", two);
    line("nanoflann, sorted", "1", nanoflann);
    if (cloudcompare_) line("CloudCompare", "1", peer);
  }

  const Options& options_;
  const bool cloudcompare_ = is_installed("CloudCompare");
  TemporaryFolder folder_;
  Progress progress_;
  std::vector<float> expected_;  ///< Distances that all methods must find.
};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Times of closest points on meshes and in clouds: writes closest.md.\n"
      "Example: gantry-bench-closest --bunny bun_zipper.ply --out docs/results",
      "gantry-bench-closest"};
  CommonOptions common;
  add_common_options(app, common);
  Options o;
  std::string measure;
  std::filesystem::path folder;
  app.add_option("--bunny", o.bunny, "Mesh of the Stanford bunny (bun_zipper.ply); without it the bracket")
      ->envname("GANTRY_BUNNY")
      ->check(CLI::ExistingFile);
  app.add_option("--rounds", o.rounds, "Of every line")->check(CLI::Range(1, 100))->capture_default_str();
  app.add_option("--out", o.out, "Folder of the page")->capture_default_str();
  app.add_flag("--quick", o.quick, "Few points, to see that it works");
  app.add_option("--measure", measure)->group("");
  app.add_option("--folder", folder)->group("");
  return run_app(app, argc, argv, common, [&] {
    if (!measure.empty()) {
      measure_here(measure, folder);
      return ExitCode::kPass;
    }
    std::filesystem::create_directories(o.out);
    Bench bench(o);
    const std::string page = bench.page();
    std::ofstream file(o.out / "closest.md");
    file << page;
    if (!file.flush()) throw InputError((o.out / "closest.md").string() + ": cannot be written");
    return ExitCode::kPass;
  });
}
