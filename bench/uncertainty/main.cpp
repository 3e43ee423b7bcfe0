// Do the stated uncertainties of an inspection hold? Whole inspections of simulated parts, of which the truth
// is known. Writes docs/results/uncertainty.md.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>

#include "app.h"
#include "gantry/foundation/error.h"
#include "markdown.h"
#include "normal_chart.h"
#include "process.h"
#include "progress.h"
#include "simulated_inspection.h"
#include "stopwatch.h"

namespace {

using namespace gantry;
using namespace gantry::bench;

constexpr double kWithin = 1.96;  ///< Standard uncertainties on each side: 95 %.

struct Options {
  size_t runs = 200;
  int columns = 960;
  double distortion_mm = 0.02;
  std::filesystem::path examples = "examples", out = "docs/results";
};

/// Deviations in units of their stated standard uncertainty, over all inspections of a kind.
struct Coverage {
  size_t points = 0, within = 0;
  double squares = 0, uncertainty = 0;
  std::vector<double> normalised;   ///< A few hundred of every inspection.
  std::vector<double> of_each_run;  ///< Share within, by inspection.

  void add(const std::vector<Judged>& judged, bool only_smooth) {
    size_t mine = 0, inside = 0;
    for (const Judged& j : judged) {
      if (only_smooth && !j.smooth) continue;
      const double z = (j.measured - j.truth) / j.uncertainty;
      ++mine;
      inside += std::abs(z) <= kWithin;
      squares += z * z;
      uncertainty += j.uncertainty;
      if (mine % 10 == 0) normalised.push_back(z);
    }
    points += mine;
    within += inside;
    if (mine > 0) of_each_run.push_back(static_cast<double>(inside) / static_cast<double>(mine));
  }
  double share() const {
    return static_cast<double>(within) / static_cast<double>(std::max<size_t>(1, points));
  }
};

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))];
}

/// What became of all inspections of one kind.
struct Tally {
  Coverage all, smooth;
  size_t runs = 0, undecided_by_registration = 0;
  size_t good = 0, good_pass = 0, good_fail = 0;  ///< Parts whose truth is within the tolerance.
  size_t bad = 0, bad_pass = 0, bad_fail = 0;
  UncertaintyBudget budget;  ///< Sums of variances.

  void add(const Trial& trial, const Outcome& outcome) {
    ++runs;
    if (!outcome.trouble.empty()) {
      ++undecided_by_registration;
      return;
    }
    all.add(outcome.points, false);
    smooth.add(outcome.points, true);
    const InspectionResult& result = outcome.inspection;
    const bool pass = result.verdict == Verdict::kPass, fail = result.verdict == Verdict::kFail;
    if (outcome.largest_truth_mm <= trial.tolerance_mm) {
      ++good;
      good_pass += pass;
      good_fail += fail;
    } else {
      ++bad;
      bad_pass += pass;
      bad_fail += fail;
    }
    for (double UncertaintyBudget::*part : {&UncertaintyBudget::noise, &UncertaintyBudget::scan_poses,
                                            &UncertaintyBudget::alignment, &UncertaintyBudget::sensor})
      budget.*part += result.budget.*part * (result.budget.*part);
  }
  double mean(double UncertaintyBudget::*part) const {
    return std::sqrt(budget.*part /
                     static_cast<double>(std::max<size_t>(1, runs - undecided_by_registration)));
  }
};

struct Kind {
  std::string name, words;
  double distortion_mm = 0;
  Tally tally;
};

/// Of random size, on both sides of the tolerance.
BracketDefects draw_defects(std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform;
  BracketDefects d;
  d.dent_depth_mm = 0.6 * uniform(random);
  d.burr_height_mm = uniform(random) < 0.3 ? 0.6 * uniform(random) : 0;
  d.flange_bend_rad = uniform(random) < 0.3 ? 0.01 * uniform(random) : 0;
  return d;
}

void run(Kind& kind, const Options& o, const SimulatedInspection& cell, Progress& progress) {
  for (size_t r = 0; r < o.runs; ++r) {
    progress.stage(text("%s: inspection %zu of %zu", kind.name.c_str(), r + 1, o.runs));
    std::mt19937_64 random(9000 + r);
    Trial trial;
    trial.seed = 100 + r;
    trial.columns = o.columns;
    trial.distortion_mm = trial.systematic_mm = kind.distortion_mm;
    trial.defects = draw_defects(random);
    kind.tally.add(trial, cell.run(trial));
  }
}

std::string percent(double share) {
  return text("%.1f %%", 100 * share);
}
std::string um(double mm) {
  return text("%.1f", 1000 * mm);
}

std::string coverage_table(const std::vector<Kind>& kinds) {
  Table table({"sensor", "inspections", "points", "within ± 1.96 u", "worst tenth of inspections",
               "rms of (measured − true) / u", "mean u, µm", "smooth surface only"});
  for (const Kind& k : kinds) {
    const Coverage& c = k.tally.all;
    table.add({k.words, std::to_string(c.of_each_run.size()), std::to_string(c.points),
               "**" + percent(c.share()) + "**", percent(percentile(c.of_each_run, 0.1)),
               text("%.2f", std::sqrt(c.squares / static_cast<double>(c.points))),
               um(c.uncertainty / static_cast<double>(c.points)), percent(k.tally.smooth.share())});
  }
  return table.str();
}

std::string budget_table(const std::vector<Kind>& kinds) {
  Table table({"sensor", "noise, µm", "scan poses", "alignment to CAD", "common to neighbours"});
  for (const Kind& k : kinds)
    table.add({k.words, um(k.tally.mean(&UncertaintyBudget::noise)),
               um(k.tally.mean(&UncertaintyBudget::scan_poses)),
               um(k.tally.mean(&UncertaintyBudget::alignment)),
               um(k.tally.mean(&UncertaintyBudget::sensor))});
  return table.str();
}

std::string verdict_table(const std::vector<Kind>& kinds) {
  Table table({"sensor", "truly within", "PASS", "FAIL", "UNDECIDED", "truly out", "PASS", "FAIL",
               "UNDECIDED", "registration undecided"});
  const auto n = [](size_t v) { return std::to_string(v); };
  for (const Kind& k : kinds) {
    const Tally& t = k.tally;
    table.add({k.words, n(t.good), n(t.good_pass), n(t.good_fail), n(t.good - t.good_pass - t.good_fail),
               n(t.bad), n(t.bad_pass), n(t.bad_fail), n(t.bad - t.bad_pass - t.bad_fail),
               n(t.undecided_by_registration)});
  }
  return table.str();
}

void write_page(const Options& o) {
  std::filesystem::create_directories(o.out);
  const Stopwatch watch;
  Progress progress(stdout_is_terminal());
  const SimulatedInspection cell(o.examples / "cells" / "simulated.yaml",
                                 o.examples / "plans" / "bracket.yaml");
  std::vector<Kind> kinds = {{"noise", "sensor with noise only", 0, {}},
                             {"distortion",
                              text("sensor also distorts by %.0f µm rms", 1000 * o.distortion_mm),
                              o.distortion_mm,
                              {}}};
  for (Kind& kind : kinds) run(kind, o, cell, progress);

  std::string page = "# Stated uncertainties, put to the test\n\nMade by `scripts/bench uncertainty`";
  page += text(
      ": %zu inspections of each kind, each of a part and a cell of its own. The simulated cell's axes and "
      "sensor stand "
      "elsewhere than its calibration says, by amounts drawn from the uncertainties that "
      "`examples/cells/simulated.yaml` "
      "states; the part is put down imprecisely; eleven scans of %d columns are taken with noise, mixed "
      "pixels and "
      "shadows, registered, merged, aligned to the CAD model by best fit and inspected. Defects are a dent, "
      "at times a "
      "burr and a bent flange, all of random size. The truth of a point is the deviation of the part's own "
      "mesh at the "
      "place nearest to it; nothing of the inspection enters it.\n\n",
      o.runs, o.columns);
  page += "## Do 95 % intervals hold 95 %?\n" + coverage_table(kinds) +
          "\nThe share is over all points of all inspections. Points of one inspection err together (poses, "
          "alignment, sensor), so that single inspections scatter: the tenth with the least is given too.\n\n"
          "![Distribution of normalised errors](uncertainty.svg)\n\n";
  page +=
      "## What an uncertainty is made of\nStandard uncertainties of the median point, root mean square over "
      "inspections.\n\n" +
      budget_table(kinds);
  page += text(
              "\n## Verdicts\nTolerance ± %.1f mm. A part is truly out when its mesh deviates by more "
              "anywhere, be it "
              "by a micrometre and in a single point.\n\n",
              Trial().tolerance_mm) +
          verdict_table(kinds);
  page +=
      text("\n*%.0f minutes of CPU time, at most %.0f MB.*\n", watch.spent().cpu_s / 60, peak_memory_mb());

  NormalChart chart;
  chart.title = "(measured − true deviation) / stated standard uncertainty";
  for (const Kind& k : kinds) chart.series.push_back({k.words, k.tally.all.normalised});
  save_normal_chart(o.out / "uncertainty.svg", chart);
  std::ofstream file(o.out / "uncertainty.md");
  file << page;
  if (!file.flush()) throw InputError((o.out / "uncertainty.md").string() + ": cannot be written");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Whole inspections of simulated parts, against the truth: writes uncertainty.md and its plot.\n"
      "Example: gantry-bench-uncertainty --runs 200 --out docs/results",
      "gantry-bench-uncertainty"};
  CommonOptions common;
  add_common_options(app, common);
  Options o;
  app.add_option("--runs", o.runs, "Inspections of every kind")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  app.add_option("--columns", o.columns, "Of the simulated sensor")
      ->check(CLI::Range(320, 3840))
      ->capture_default_str();
  app.add_option("--distortion", o.distortion_mm, "Of the sensor, mm rms, in the last kind")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  app.add_option("--examples", o.examples, "Folder with cells/ and plans/")->capture_default_str();
  app.add_option("--out", o.out, "Folder of the page")->capture_default_str();
  return run_app(app, argc, argv, common, [&] {
    write_page(o);
    return ExitCode::kPass;
  });
}
