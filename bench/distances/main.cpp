// The paper's experiment on distance metrics: which of them tell a known shift, and what noise, holes and
// sparse points do to them. Writes the page that docs/results/distances.md shows.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>

#include "app.h"
#include "experiment.h"
#include "markdown.h"
#include "progress.h"
#include "reference_values.h"
#include "stopwatch.h"
#include "sweep_chart.h"

namespace {

using namespace gantry;
using namespace gantry::bench;

/// One perturbation at rising strength; the first value is none at all.
struct Sweep {
  std::string name, x_title;
  double Perturbation::*strength;
  std::vector<double> values;
};
const std::vector<Sweep> kSweeps = {
    {"noise", "standard deviation of the noise, m", &Perturbation::noise_m, {0, 0.01, 0.02, 0.05, 0.1}},
    {"hole", "radius of the hole, m", &Perturbation::hole_m, {0, 0.1, 0.2, 0.3, 0.4, 0.5}},
    {"sampling",
     "sampling factor: one point in so many is kept",
     &Perturbation::sampling_factor,
     {1, 2, 5, 10, 20}}};

using Row = std::map<Metric, Deviation>;

/// All conditions, each run once.
class Experiment {
 public:
  Experiment(const ExperimentOptions& options, size_t conditions)
      : options_(options), conditions_(conditions), progress_(stdout_is_terminal()) {}

  const Row& at(Shape shape, const Perturbation& p) {
    const auto key = std::tuple(shape, p.noise_m, p.hole_m, p.sampling_factor);
    if (const auto found = rows_.find(key); found != rows_.end()) return found->second;
    progress_.stage(
        text("condition %zu of %zu: %s", rows_.size() + 1, conditions_, to_string(shape).c_str()));
    return rows_[key] = run_condition({shape, p}, options_);
  }

 private:
  ExperimentOptions options_;
  size_t conditions_;
  Progress progress_;
  std::map<std::tuple<Shape, double, double, double>, Row> rows_;
};

/// -.109, as the field writes numbers below one.
std::string number(double value) {
  std::string s = text("%.3f", value);
  if (s == "-0.000") s = "0.000";
  s.erase(s.find("0."), 1);
  return s;
}

std::string heading(Metric metric) {
  return std::string(to_string(metric));
}

std::string comparison_table(Experiment& experiment, size_t& outside) {
  std::vector<std::string> header = {"deviation"};
  for (const Metric metric : kReferenceMetrics) header.push_back(heading(metric));
  Table table(header);
  outside = 0;
  for (const ReferenceRow& reference : kReferenceRows) {
    Perturbation p;
    p.noise_m = reference.noise_m;
    p.hole_m = reference.hole_m;
    const Row& row = experiment.at(reference.shape, p);
    std::vector<std::string> cells = {std::string(reference.name)};
    for (size_t m = 0; m < kReferenceMetrics.size(); ++m) {
      const Deviation& d = row.at(kReferenceMetrics[m]);
      constexpr double kRounding = 0.0005;  // of the reference
      const bool agrees = std::abs(d.mean - reference.deviation[m]) <= d.spread + kRounding;
      outside += !agrees;
      cells.push_back(number(d.mean) + " ± " + number(d.spread) + " (" + number(reference.deviation[m]) +
                      ")" + (agrees ? "" : " **✱**"));
    }
    table.add(cells);
  }
  return table.str();
}

std::string shift_table(Experiment& experiment, const std::vector<Metric>& metrics) {
  std::vector<std::string> header = {"mean shift from clean"}, reference = {"reference value"};
  for (const Metric metric : metrics) {
    header.push_back(heading(metric));
    const auto found = std::find(kReferenceMetrics.begin(), kReferenceMetrics.end(), metric);
    reference.push_back(
        found == kReferenceMetrics.end()
            ? "–"
            : number(kReferenceShift[static_cast<size_t>(found - kReferenceMetrics.begin())]));
  }
  Table table(header);
  std::map<Metric, double> sums;
  size_t conditions = 0;
  for (const Sweep& sweep : kSweeps) {
    std::map<Metric, double> of_sweep;
    for (const Shape shape : kShapes)
      for (size_t i = 1; i < sweep.values.size(); ++i) {
        Perturbation p;
        p.*sweep.strength = sweep.values[i];
        for (const Metric m : metrics)
          of_sweep[m] += std::abs(experiment.at(shape, p).at(m).mean - experiment.at(shape, {}).at(m).mean);
      }
    const size_t count = std::size(kShapes) * (sweep.values.size() - 1);
    conditions += count;
    std::vector<std::string> cells = {sweep.name};
    for (const Metric m : metrics) {
      cells.push_back(number(of_sweep[m] / static_cast<double>(count)));
      sums[m] += of_sweep[m];
    }
    table.add(cells);
  }
  std::vector<std::string> cells = {"all"};
  for (const Metric m : metrics) cells.push_back(number(sums[m] / static_cast<double>(conditions)));
  table.add(cells);
  table.add(reference);
  return table.str();
}

void save_sweep(Experiment& experiment, const Sweep& sweep, const std::vector<Metric>& metrics,
                const std::filesystem::path& path) {
  SweepChart chart;
  chart.title = "Distance metrics and " + sweep.name;
  chart.x_title = sweep.x_title;
  chart.y_title = "deviation from the true shift in m (chamfer-squared: m²), strokes: ± one spread";
  for (const double value : sweep.values) chart.positions.push_back(text("%g", value));
  for (const Metric m : metrics) chart.series.push_back(heading(m));
  for (const Shape shape : kShapes) {
    SweepChart::Panel panel{to_string(shape), {}};
    for (const Metric m : metrics) {
      panel.lines.emplace_back();
      for (const double value : sweep.values) {
        Perturbation p;
        p.*sweep.strength = value;
        const Deviation& d = experiment.at(shape, p).at(m);
        panel.lines.back().push_back({d.mean, d.spread});
      }
    }
    chart.panels.push_back(std::move(panel));
  }
  save_sweep_chart(path, chart);
}

std::string conventions(const ExperimentOptions& o) {
  return text(
      "The paper moves copies of four surfaces by a known distance and asks every metric for it. It does not "
      "say "
      "how exactly; here:\n\n"
      "- **Surfaces**: x, y in [0, 1] m; height by x only: plane 0, slope 0.5 x, sine and triangular wave of "
      "amplitude 0.1 m and two periods, in 16 segments. The reference are %zu points, evenly at random over "
      "the "
      "area; for cloud-to-mesh the mesh itself.\n"
      "- **Copy**: the same points, 0.5 m higher. Only the copy is perturbed: Gaussian noise on each "
      "coordinate; a "
      "hole of some radius in x, y about the centroid; or one point in so many kept at random.\n"
      "- **Metrics**: as `gantry/inspection/distances.h` defines them, k = 6 and the 95th percentile. Earth "
      "Mover's is exact; where points are missing it matches those that are there.\n"
      "- **Deviation**: metric − 0.5 m; chamfer-squared, which is 0.5 m² for a plane, in m². Mean ± standard "
      "deviation over %zu runs, each with points of its own.\n\n",
      o.points, o.runs);
}

std::string findings() {
  return "What it shows:\n\n"
         "- The truth is a *vertical* 0.5 m. Whatever measures to the nearest point or surface measures "
         "across: on "
         "the slope 0.5 cos θ = 0.447 m, a deviation of −0.053 m. That is geometry, no error of a metric.\n"
         "- Noise, holes and sparse points hardly move the local models and cloud-to-mesh: they measure from "
         "the "
         "copy to a reference that is whole. The mesh is the one to trust, since it needs no model; at k = 6 "
         "the "
         "plane and the quadric cut the corners of the triangular wave.\n"
         "- Hausdorff is hurt by noise, by holes and by sparse points; its 95th percentile by half as much. "
         "Chamfer is hurt most by noise.\n"
         "- Earth Mover's alone tells the vertical shift, noise or not, as long as both clouds have the same "
         "points. Without that its partners are free to be chosen for their nearness, and it falls to what "
         "the "
         "others find.\n"
         "- M3C2 says what its scale says: the normals chosen here (over some 0.3 m) look through the waves, "
         "and "
         "it tells the shift of the whole.\n\n";
}

void write_page(const ExperimentOptions& o, const std::filesystem::path& out, bool quick) {
  std::filesystem::create_directories(out);
  const Stopwatch watch;
  size_t conditions = 1;
  for (const Sweep& sweep : kSweeps) conditions += sweep.values.size() - 1;
  Experiment experiment(o, conditions * std::size(kShapes));

  std::string page = "# Distance metrics, measured\n\n";
  if (quick) page += "**A quick run: few draws, to see that the benchmark works. Not for quoting.**\n\n";
  page += "Made by `scripts/bench distances`.\n\n" + conventions(o);
  size_t outside = 0;
  const std::string table = comparison_table(experiment, outside);
  page +=
      "## Against reference values\nIn parentheses the reference values, from an earlier "
      "re-run. ";
  page += outside == 0
              ? "All agree within the spread of the runs.\n\n"
              : text("✱ marks the %zu that differ by more than the spread of the runs.\n\n", outside);
  page += table;
  page += "## What perturbations do\n";
  page +=
      "Mean over shapes and strengths of |deviation − deviation of the same shape unperturbed|, in m. Which "
      "strengths the reference "
      "value is the mean of is not known, so that only its size compares.\n\n";
  page += shift_table(experiment, o.metrics);
  page += findings();
  for (const Sweep& sweep : kSweeps) {
    const std::string file = "distances_" + sweep.name + ".svg";
    save_sweep(experiment, sweep, o.metrics, out / file);
    page += "![Deviation by " + sweep.name + "](" + file + ")\n\n";
  }
  page += text("*%.1f minutes of CPU time.*\n", watch.spent().cpu_s / 60);
  std::ofstream file(out / "distances.md");
  file << page;
  if (!file.flush()) throw InputError((out / "distances.md").string() + ": cannot be written");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "The paper's experiment on distance metrics: writes distances.md and its plots.\n"
      "Example: gantry-bench-distances --out docs/results",
      "gantry-bench-distances"};
  CommonOptions common;
  add_common_options(app, common);
  ExperimentOptions o;
  std::filesystem::path out = "docs/results";
  bool quick = false;
  auto* runs = app.add_option("--runs", o.runs, "Of every condition")
                   ->check(CLI::Range(2, 10000))
                   ->capture_default_str();
  app.add_option("--points", o.points, "Of the reference")
      ->check(CLI::Range(100, 2000))
      ->capture_default_str();
  app.add_option("--out", out, "Folder of the page")->capture_default_str();
  app.add_flag("--quick", quick, "Three runs, to see that it works")->excludes(runs);
  return run_app(app, argc, argv, common, [&] {
    if (quick) o.runs = 3;
    o.metrics.assign(all_metrics().begin(), all_metrics().end());
    write_page(o, out, quick);
    return ExitCode::kPass;
  });
}
