// What an inspection finds and what it makes up: dents of many depths and diameters in a plate that the
// simulated sensor scans. Writes the page that docs/results/detection.md shows, with its curves.

#include <algorithm>
#include <fstream>
#include <map>

#include "app.h"
#include "dented_plate.h"
#include "detection_chart.h"
#include "gantry/inspection/inspection.h"
#include "markdown.h"
#include "progress.h"
#include "stopwatch.h"

namespace {

using namespace gantry;
using namespace gantry::bench;

const std::vector<double> kDepths = {0.06, 0.08, 0.1, 0.11, 0.12, 0.135, 0.15, 0.18, 0.22, 0.3, 0.4, 0.6};
const std::vector<double> kDiameters = {1, 1.5, 2, 3, 5, 8};
constexpr size_t kDentsOfPlate = 24;

struct Options {
  std::filesystem::path out = "docs/results";
  size_t repeats = 12, clean = 24;
  double tolerance_mm = 0.1;
  bool quick = false;
};

struct Outcome {
  std::map<double, std::vector<Trial>> listed, certain;  ///< By diameter.
  size_t false_alarms = 0, certain_false_alarms = 0, plates = 0, verdicts[3] = {0, 0, 0};
  size_t clean_alarms = 0, clean_certain = 0, clean_verdicts[3] = {0, 0, 0};
  size_t points = 0;
  double mean_uncertainty_mm = 0;  ///< Standard, of the clean plates' points.
};

class Experiment {
 public:
  explicit Experiment(const Options& options) : options_(options), cad_(dented_plate({})) {
    inspection_.tolerance_mm = options.tolerance_mm;
    inspection_.min_coverage = 0.3;  // only the top is scanned
    inspection_.symmetry_tolerance_mm = 0;
  }

  Outcome run() {
    std::vector<Dent> dents;
    for (size_t r = 0; r < options_.repeats; ++r)
      for (const double depth : kDepths)
        for (const double diameter : kDiameters)
          dents.push_back({.depth_mm = depth, .diameter_mm = diameter});
    // Every plate holds dents of all sizes: they go round.
    const size_t plates = dents.size() / kDentsOfPlate;
    for (size_t p = 0; p < plates; ++p) {
      progress_.stage(text("plate %zu of %zu", p + 1, plates + options_.clean));
      std::vector<Dent> of_plate;
      for (size_t k = 0; k < kDentsOfPlate; ++k) of_plate.push_back(dents[(k * plates + p) % dents.size()]);
      inspect_dented(of_plate, 1000 + p);
    }
    for (size_t p = 0; p < options_.clean; ++p) {
      progress_.stage(text("plate %zu of %zu", plates + p + 1, plates + options_.clean));
      inspect_clean(2000 + p);
    }
    progress_.clear();
    return std::move(outcome_);
  }

 private:
  void inspect_dented(std::vector<Dent> dents, uint64_t seed) {
    const std::vector<Eigen::Vector2d> places = dent_places(dents.size(), seed);
    for (size_t k = 0; k < dents.size(); ++k) dents[k].centre_mm = places[k];
    const InspectionResult result = inspect(scanned_plate(dented_plate(dents), seed), cad_, inspection_);
    ++outcome_.plates;
    ++outcome_.verdicts[static_cast<int>(result.verdict)];
    std::vector<unsigned char> explained(result.defects.size(), 0);
    for (const Dent& dent : dents) {
      bool listed = false, certain = false;
      for (size_t i = 0; i < result.defects.size(); ++i) {
        const Defect& defect = result.defects[i];
        if ((defect.peak_at_mm.head<2>() - dent.centre_mm).norm() > dent.diameter_mm / 2 + 1) continue;
        explained[i] = 1;
        listed = listed || defect.peak_mm < 0;
        certain = certain || (defect.peak_mm < 0 && defect.certain);
      }
      outcome_.listed[dent.diameter_mm].push_back({dent.depth_mm, listed});
      outcome_.certain[dent.diameter_mm].push_back({dent.depth_mm, certain});
    }
    for (size_t i = 0; i < explained.size(); ++i) {
      outcome_.false_alarms += !explained[i];
      outcome_.certain_false_alarms += !explained[i] && result.defects[i].certain;
    }
  }

  void inspect_clean(uint64_t seed) {
    const InspectionResult result = inspect(scanned_plate(cad_.mesh(), seed), cad_, inspection_);
    ++outcome_.clean_verdicts[static_cast<int>(result.verdict)];
    outcome_.clean_alarms += result.defects.size();
    outcome_.clean_certain += static_cast<size_t>(std::count_if(result.defects.begin(), result.defects.end(),
                                                                [](const Defect& d) { return d.certain; }));
    outcome_.points += result.statistics.count;
    for (const float u : result.uncertainty_mm)
      if (u == u) outcome_.mean_uncertainty_mm += u;
  }

  const Options& options_;
  SignedDistance cad_;
  InspectionOptions inspection_;
  Outcome outcome_;
  Progress progress_{stdout_is_terminal()};
};

void add_rows(Table& table, const std::map<double, std::vector<Trial>>& trials, DetectionChart& chart) {
  for (const auto& [diameter, all] : trials) {
    const auto curve = fit_detection(all);
    chart.series.push_back({text("%g mm wide", diameter), curve, all});
    const auto found = std::count_if(all.begin(), all.end(), [](const Trial& t) { return t.found; });
    const auto size = [&](double DetectionCurve::*value) {
      if (!curve) return std::string("–");
      const double depth = (*curve).*value;
      return depth > kDepths.back() ? text("over %g", kDepths.back()) : text("%.3f", depth);
    };
    table.add({text("%g", diameter), text("%zd of %zu", found, all.size()), size(&DetectionCurve::a50_mm),
               size(&DetectionCurve::a90_mm), size(&DetectionCurve::a90_95_mm)});
  }
}

std::string page_of(const Options& o, const Outcome& outcome, double cpu_s) {
  std::string page = "# Detection limits, by simulation\n\n";
  if (o.quick) page += "**A quick run: few plates, to see that the benchmark works. Not for quoting.**\n\n";
  page += "Made by `scripts/bench detection`.\n\n";
  page += text(
      "Dents, `depth (1 + cos(pi r / R)) / 2`, in the top of a plate of 120 x 90 x 5 mm, %zu to a plate, %zu "
      "of each of "
      "%zu depths and %zu diameters; places, views and noise are drawn anew for every plate. The simulated "
      "sensor "
      "(0.05 mm noise at 500 mm, 0.18 mm pixels) scans it from four sides, 20 degrees off the normal. The "
      "scans are "
      "merged **at their true poses**: what registration leaves over is not in these figures. Then the "
      "product's "
      "inspection, with best fit, at a tolerance of ±%g mm and otherwise default options (%g mm of standard "
      "uncertainty that neighbouring points share).\n\n",
      kDentsOfPlate, o.repeats, kDepths.size(), kDiameters.size(), o.tolerance_mm,
      InspectionOptions().systematic_sigma_mm);
  page +=
      "*Listed*: a region out of tolerance has its peak within the dent (1 mm beside it at most). *Certain*: "
      "and it "
      "exceeds the tolerance by more than the guard band, so that the verdict is FAIL. Curves are "
      "logistic in log "
      "depth, as MIL-HDBK-1823A has it for hit/miss data, fitted by Firth's penalised likelihood: a50 and "
      "a90 are the "
      "depths found with a probability of 50 and 90 %, a90/95 is what a90 does not exceed with 95 % "
      "confidence.\n\n";
  page +=
      "A dent shallower than the tolerance is no defect: the best that there can be is a step at the "
      "tolerance. Narrow "
      "dents fall short of it because points are averaged over half a millimetre and because regions under 1 "
      "mm² are "
      "not reported: of a narrow dent little lies beyond the tolerance.\n\n";
  DetectionChart listed{"Dents listed as out of tolerance", o.tolerance_mm, {}};
  DetectionChart certain{"Dents certainly out of tolerance", o.tolerance_mm, {}};
  for (auto* chart : {&listed, &certain}) {
    const bool first = chart == &listed;
    Table table({"diameter, mm", "found", "a50, mm", "a90, mm", "a90/95, mm"});
    add_rows(table, first ? outcome.listed : outcome.certain, *chart);
    const std::string file = first ? "detection_listed.svg" : "detection_certain.svg";
    save_detection_chart(o.out / file, *chart);
    page += std::string("## ") + (first ? "Listed" : "Certain") + "\n" + table.str() + "\n![" + chart->title +
            "](" + file + ")\n\n";
  }
  page += "## False alarms\n";
  Table table({"plates", "regions listed that are no dent", "of which certain", "PASS / FAIL / UNDECIDED"});
  table.add({text("%zu clean", o.clean), text("%zu", outcome.clean_alarms),
             text("%zu", outcome.clean_certain),
             text("%zu / %zu / %zu", outcome.clean_verdicts[0], outcome.clean_verdicts[1],
                  outcome.clean_verdicts[2])});
  table.add({text("%zu with %zu dents", outcome.plates, kDentsOfPlate), text("%zu", outcome.false_alarms),
             text("%zu", outcome.certain_false_alarms),
             text("%zu / %zu / %zu", outcome.verdicts[0], outcome.verdicts[1], outcome.verdicts[2])});
  page += table.str();
  if (outcome.clean_alarms == 0 && o.clean > 0)
    page += text("\nNo false alarm in %zu clean plates: with 95 %% confidence fewer than %.2f a plate.\n",
                 o.clean, 3.0 / static_cast<double>(o.clean));
  if (outcome.points > 0)
    page += text("\nMean standard uncertainty of a point's deviation: %.4f mm.\n",
                 outcome.mean_uncertainty_mm / static_cast<double>(outcome.points));
  return page + text("\n*%.1f minutes of CPU time.*\n", cpu_s / 60);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Probability of detection of dents, and false alarms: writes detection.md and its curves.\n"
      "Example: gantry-bench-detection --out docs/results",
      "gantry-bench-detection"};
  CommonOptions common;
  add_common_options(app, common);
  Options o;
  app.add_option("--repeats", o.repeats, "Dents of every depth and diameter")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--clean", o.clean, "Plates without a dent")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--tolerance", o.tolerance_mm, "+- mm")->check(CLI::Range(0.01, 1.0))->capture_default_str();
  app.add_option("--out", o.out, "Folder of the page")->capture_default_str();
  app.add_flag("--quick", o.quick, "One repeat and two clean plates, to see that it works");
  return run_app(app, argc, argv, common, [&] {
    if (o.quick) o.repeats = 1, o.clean = 2;
    std::filesystem::create_directories(o.out);
    const Stopwatch watch;
    const Outcome outcome = Experiment(o).run();
    const std::string page = page_of(o, outcome, watch.spent().cpu_s);
    std::ofstream file(o.out / "detection.md");
    file << page;
    if (!file.flush()) throw InputError((o.out / "detection.md").string() + ": cannot be written");
    return ExitCode::kPass;
  });
}
