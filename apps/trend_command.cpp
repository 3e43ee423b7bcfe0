#include "trend_command.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "gantry/acquisition/journal.h"
#include "gantry/inspection/gauge.h"
#include "gantry/inspection/series.h"

namespace gantry {
namespace {

constexpr const char* kSoftware = "gantry " GANTRY_VERSION;
constexpr size_t kMostRows = 12;  ///< Of a table on the terminal; all are in the files.

struct Options {
  std::vector<std::filesystem::path> runs;
  std::filesystem::path gauge, out;
  std::string figure = "mean", rules = "western-electric";
  size_t baseline = 0;
  bool json = false;
};

ControlRules rules_named(const std::string& name) {
  return name == "limits"   ? ControlRules::kLimits
         : name == "nelson" ? ControlRules::kNelson
                            : ControlRules::kWesternElectric;
}

/// "1.23", or "-" where there is none.
std::string number(double value, const char* format) {
  char text[40];
  if (!std::isfinite(value)) return "-";
  std::snprintf(text, sizeof text, format, value);
  return text;
}

void warn_of(const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) spdlog::warn("{}", warning);
}

std::string runs_text(size_t first, size_t last) {
  return first == last ? "run " + std::to_string(first + 1)
                       : "runs " + std::to_string(first + 1) + "-" + std::to_string(last + 1);
}

void print_charts(const std::string& kind, const std::vector<ControlChart>& charts) {
  if (charts.empty()) return;
  std::vector<const ControlChart*> sorted;
  for (const ControlChart& c : charts) sorted.push_back(&c);
  const auto ppk = [](const ControlChart& c) {
    return std::isfinite(c.capability.ppk.value) ? c.capability.ppk.value : 1e9;
  };
  std::stable_sort(sorted.begin(), sorted.end(), [&](const ControlChart* a, const ControlChart* b) {
    if (a->in_control() != b->in_control()) return !a->in_control();
    return ppk(*a) < ppk(*b);
  });
  const auto out_of_control = static_cast<size_t>(
      std::count_if(charts.begin(), charts.end(), [](const ControlChart& c) { return !c.in_control(); }));
  std::printf("  %zu of %zu %s out of control\n\n", out_of_control, charts.size(), kind.c_str());
  std::printf("  %-14s %10s %9s %7s %7s  %-24s %s\n", "feature", "mean mm", "sigma mm", "Cpk", "Ppk",
              "drift um/run (95 %)", "signals");
  for (size_t i = 0; i < std::min(kMostRows, sorted.size()); ++i) {
    const ControlChart& c = *sorted[i];
    const Estimate& d = c.drift.per_run_mm;
    const std::string drift = number(1000 * d.value, "%+.2f") + " (" + number(1000 * d.low, "%+.2f") +
                              " .. " + number(1000 * d.high, "%+.2f") + ")" +
                              (c.drift.significant ? " *" : "");
    std::string signals = c.in_control() ? "none" : "";
    for (size_t s = 0; s < std::min<size_t>(2, c.signals.size()); ++s)
      signals +=
          (s > 0 ? "; " : "") + runs_text(c.signals[s].first, c.signals[s].last) + ": " + c.signals[s].words;
    if (c.signals.size() > 2) signals += "; and " + std::to_string(c.signals.size() - 2) + " more";
    std::printf("  %-14.14s %10s %9s %7s %7s  %-24s %s\n", c.name.c_str(),
                number(c.centre_mm, "%+.4f").c_str(), number(c.sigma_mm, "%.4f").c_str(),
                number(c.capability.cpk.value, "%.2f").c_str(),
                number(c.capability.ppk.value, "%.2f").c_str(), std::isfinite(d.value) ? drift.c_str() : "-",
                signals.c_str());
  }
  if (sorted.size() > kMostRows)
    std::printf("  ... and %zu more %s\n", sorted.size() - kMostRows, kind.c_str());
  std::printf("\n");
}

void print_trend(const Series& series, const Trend& trend, const TrendOptions& options) {
  std::printf("\n  %s, %zu runs from %s to %s\n", series.runs.front().part.c_str(), series.runs.size(),
              series.runs.front().created.c_str(), series.runs.back().created.c_str());
  for (size_t r = 0; r < series.runs.size(); ++r)
    if (!series.runs[r].doubt.empty())
      std::printf("  run %zu, %s, does not count: %s\n", r + 1, series.runs[r].name.c_str(),
                  series.runs[r].doubt.c_str());
  std::printf("\n");
  print_charts("faces", trend.faces);
  print_charts("regions", trend.regions);
  std::printf("  %s: %zu charts of the %s deviation show a signal, about %.1f would by chance alone\n",
              trend.signalling == 0 ? "IN CONTROL"
              : trend.beyond_chance ? "OUT OF CONTROL"
                                    : "AS BY CHANCE",
              trend.signalling, std::string(to_string(options.figure)).c_str(), trend.expected_false);
  if (!trend.furthest.empty())
    std::printf("  %s lies further out than chance explains\n", trend.furthest.c_str());
  std::printf("  *: drifts (95 %% interval without 0)\n");
}

void print_gauge(const GaugeReport& report) {
  std::printf("\n  %s: %zu %s, %zu %s, %zu trials each; tolerance +-%.4g mm\n\n", report.study.name.c_str(),
              report.parts.size(), report.parts.size() == 1 ? "part" : "parts", report.appraisers.size(),
              report.appraisers.size() == 1 ? "appraiser" : "appraisers", report.trials, report.tolerance_mm);
  std::vector<const GaugeResult*> sorted;
  for (const auto* list : {&report.faces, &report.regions})
    for (const GaugeResult& r : *list) sorted.push_back(&r);
  std::stable_sort(sorted.begin(), sorted.end(), [](const GaugeResult* a, const GaugeResult* b) {
    return a->percent_tolerance.value > b->percent_tolerance.value;
  });
  std::printf("  %-14s %9s %9s %9s  %-26s %-26s %5s  %s\n", "feature", "EV mm", "AV mm", "PV mm",
              "GRR % of tolerance (95 %)", "GRR % of study (95 %)", "ndc", "by tolerance");
  const auto interval = [](const Estimate& e) {
    if (!std::isfinite(e.value)) return std::string("-");
    return number(e.value, "%.1f") + " (" + number(e.low, "%.1f") + " .. " + number(e.high, "%.1f") + ")";
  };
  for (size_t i = 0; i < std::min(2 * kMostRows, sorted.size()); ++i) {
    const GaugeResult& r = *sorted[i];
    std::printf("  %-14.14s %9s %9s %9s  %-26s %-26s %5s  %s\n", r.name.c_str(),
                number(r.ev_mm.value, "%.4f").c_str(), number(r.av_mm.value, "%.4f").c_str(),
                number(r.pv_mm.value, "%.4f").c_str(), interval(r.percent_tolerance).c_str(),
                interval(r.percent_study).c_str(), number(r.ndc.value, "%.0f").c_str(),
                gauge_words(r.percent_tolerance.value).c_str());
  }
  if (sorted.size() > 2 * kMostRows) std::printf("  ... and %zu more\n", sorted.size() - 2 * kMostRows);
  std::printf("\n  GRR under 10 %% acceptable, to 30 %% conditional, beyond not acceptable; ndc 5 or more\n");
  if (report.appraisers.size() < 2)
    std::printf("  one appraiser: what changes from operator to operator or cell to cell is not in it\n");
  if (!report.unseen.empty())
    std::printf("  %zu features that not all runs have seen were left out\n", report.unseen.size());
}

ExitCode run_gauge(const Options& o, SeriesFigure figure) {
  const GaugeStudy study = read_gauge_study(o.gauge);
  std::vector<SeriesRun> runs;
  for (const GaugeTrial& trial : study.trials) runs.push_back(read_series_run(trial.run));
  const GaugeReport report = analyse_gauge_study(study, runs, figure);
  warn_of(report.warnings);
  const std::string created = utc_now();
  if (o.json) {
    std::printf("%s", gauge_json(report, created, kSoftware).c_str());
  } else {
    print_gauge(report);
  }
  if (!o.out.empty()) {
    std::filesystem::create_directories(o.out);
    const auto page = write_gauge(o.out, report, created, kSoftware);
    if (!o.json) std::printf("\n  report     %s\n", page.c_str());
  }
  return ExitCode::kPass;
}

ExitCode run_trend(const Options& o, SeriesFigure figure) {
  std::vector<SeriesRun> runs;
  for (const auto& path : o.runs) runs.push_back(read_series_run(path));
  const Series series = make_series(std::move(runs));
  warn_of(series.warnings);
  const TrendOptions options{figure, rules_named(o.rules), o.baseline};
  const Trend trend = analyse_trend(series, options);
  const std::string created = utc_now();
  if (o.json) {
    std::printf("%s", trend_json(series, trend, options, created, kSoftware).c_str());
  } else {
    print_trend(series, trend, options);
  }
  if (!o.out.empty()) {
    std::filesystem::create_directories(o.out);
    const auto page = write_trend(o.out, series, trend, options, created, kSoftware);
    if (!o.json) std::printf("\n  report     %s\n", page.c_str());
  }
  return ExitCode::kPass;
}

}  // namespace

struct TrendCommand::Impl {
  Options options;
  CLI::App* command = nullptr;
};

TrendCommand::TrendCommand(CLI::App& app) : impl_(std::make_unique<Impl>()) {
  Options& o = impl_->options;
  CLI::App* command = impl_->command =
      app.add_subcommand("trend",
                         "The same part type over many runs: control charts, capability and drift of every "
                         "CAD face and region; or "
                         "how much the measurement itself adds (gauge R&R).\n"
                         "Example: gantry-fusion trend runs/2026-11-* --out trend\n"
                         "Example: gantry-fusion trend runs/* --baseline 20 --rules nelson --json\n"
                         "Example: gantry-fusion trend --gauge GAUGE.yaml --out gauge");
  CLI::Option* runs = command->add_option(
      "RUNS", o.runs, "Run folders, inspection folders or report.json files, in any order");
  command->add_option("--gauge", o.gauge, "GAUGE.yaml: which run is of which part, by whom; in place of RUNS")
      ->excludes(runs);
  command
      ->add_option("--figure", o.figure,
                   "What is followed of each feature's deviation: mean, sigma, p05, p95, min or max")
      ->check(CLI::IsMember({"mean", "sigma", "p05", "p95", "min", "max"}))
      ->capture_default_str();
  command
      ->add_option("--rules", o.rules,
                   "limits (3 sigma only), western-electric (its four rules) or nelson (his eight)")
      ->check(CLI::IsMember({"limits", "western-electric", "nelson"}))
      ->capture_default_str();
  command
      ->add_option("--baseline", o.baseline,
                   "So many of the first runs that count set the limits; default: all")
      ->check(CLI::Range(2, 100'000));
  command->add_option("--out", o.out, "Folder for trend.html and trend.json (gauge.html, gauge.json)");
  command->add_flag("--json", o.json, "Print the result as JSON");
}

TrendCommand::~TrendCommand() = default;

bool TrendCommand::parsed() const {
  return impl_->command->parsed();
}

ExitCode TrendCommand::run() const {
  const Options& o = impl_->options;
  if (o.runs.empty() && o.gauge.empty()) throw InputError("give the runs to look at, or --gauge GAUGE.yaml");
  if (!o.out.empty()) require_writable_folder("--out", o.out);
  const SeriesFigure figure = *series_figure_named(o.figure);
  return o.gauge.empty() ? run_trend(o, figure) : run_gauge(o, figure);
}

}  // namespace gantry
