#include <algorithm>
#include <cmath>

#include "report/text.h"
#include "series/charts.h"
#include "series/page_frame.h"

namespace gantry {
namespace {

using report::escaped;
using report::fixed;
using report::with_sign;
using series::cell;
using series::estimate_text;

// These keep the page readable, whatever the size of the part.
constexpr size_t kMostFaceCharts = 24, kMostRegionCharts = 8, kMostRegionRows = 20;

using Charts = std::vector<const ControlChart*>;

double ppk_of(const ControlChart& c) {
  return std::isfinite(c.capability.ppk.value) ? c.capability.ppk.value : 1e9;
}

/// Those that ask for attention first: out of control, then least capable.
Charts by_urgency(const std::vector<ControlChart>& charts) {
  Charts sorted;
  for (const ControlChart& chart : charts) sorted.push_back(&chart);
  std::stable_sort(sorted.begin(), sorted.end(), [](const ControlChart* a, const ControlChart* b) {
    if (a->in_control() != b->in_control()) return !a->in_control();
    return ppk_of(*a) < ppk_of(*b);
  });
  return sorted;
}

size_t signalling(const std::vector<ControlChart>& charts) {
  return static_cast<size_t>(
      std::count_if(charts.begin(), charts.end(), [](const ControlChart& c) { return !c.in_control(); }));
}

std::string signal_text(const ControlSignal& s) {
  const std::string runs =
      s.first == s.last ? "run " + std::to_string(s.last + 1)
                        : "runs " + std::to_string(s.first + 1) + "\u2013" + std::to_string(s.last + 1);
  return runs + ": " + escaped(s.words) + " <span class=\"soft\">(" + escaped(s.rule) + ")</span>";
}

std::string chips(const ControlChart& c) {
  std::string html = c.in_control() ? "<span class=\"chip good\">in control</span>"
                                    : "<span class=\"chip poor\">" + std::to_string(c.signals.size()) +
                                          (c.signals.size() == 1 ? " signal" : " signals") + "</span>";
  if (c.drift.significant) html += "<span class=\"chip fair\">drifts</span>";
  return html;
}

std::string table(const Charts& charts, size_t most) {
  std::string html =
      "<div class=\"defects card\"><table><thead><tr><th>Feature</th><th class=\"n\">Mean<br>mm</th>"
      "<th class=\"n\">\u03c3 short-term<br>mm</th><th class=\"n\">Measurement u<br>mm</th>"
      "<th class=\"n\">Cpk<br>95\u202f% interval</th><th class=\"n\">Ppk<br>95\u202f% interval</th>"
      "<th class=\"n\">Drift<br>\u00b5m per run</th><th>State</th></tr></thead><tbody>\n";
  for (size_t i = 0; i < std::min(most, charts.size()); ++i) {
    const ControlChart& c = *charts[i];
    Estimate drift = c.drift.per_run_mm;
    for (double* v : {&drift.value, &drift.low, &drift.high}) *v *= 1000;
    html += "<tr>" + series::feature_cell(c.name, c.words) + cell(with_sign(c.centre_mm, 4)) +
            cell(fixed(c.sigma_mm, 4)) + cell(fixed(c.uncertainty_mm, 4)) +
            cell(estimate_text(c.capability.cpk, 2)) + cell(estimate_text(c.capability.ppk, 2)) +
            cell(estimate_text(drift, 2)) + "<td>" + chips(c) + "</td></tr>\n";
  }
  html += "</tbody></table></div>\n";
  if (charts.size() > most)
    html += "<p class=\"lead\">" + std::to_string(charts.size() - most) + " more are in trend.json.</p>\n";
  return html;
}

std::string chart_grid(const Charts& charts, size_t most, const Series& series) {
  std::string html = "<div class=\"charts\">";
  for (size_t i = 0; i < std::min(most, charts.size()); ++i) {
    const ControlChart& c = *charts[i];
    html += "<figure class=\"card control-box\"><figcaption><b>" + escaped(c.name) + "</b><span>" +
            escaped(c.words) + "</span></figcaption>" + series::control_chart_svg(c, series);
    constexpr size_t kMostSignals = 3;
    for (size_t s = 0; s < std::min(kMostSignals, c.signals.size()); ++s)
      html += "<p class=\"fine\"><span class=\"signal\">\u25cf</span> " + signal_text(c.signals[s]) + "</p>";
    if (c.signals.size() > kMostSignals)
      html += "<p class=\"fine\">and " + std::to_string(c.signals.size() - kMostSignals) + " more</p>";
    html += "</figure>\n";
  }
  return html + "</div>\n";
}

std::string section(const std::string& title, const std::string& lead, const std::string& content) {
  return "<section><h2>" + title + "</h2><p class=\"lead\">" + lead + "</p>\n" + content + "</section>\n";
}

series::Banner banner_of(const Trend& trend) {
  const size_t charts = trend.faces.size() + trend.regions.size();
  std::string chance = std::to_string(trend.signalling) + " of " + std::to_string(charts) +
                       " control charts show a signal; by chance alone about " +
                       fixed(trend.expected_false, 1) + " would.";
  if (!trend.furthest.empty()) chance += " But " + trend.furthest + " lies further out than chance explains.";
  if (trend.signalling == 0)
    return {"pass", "IN CONTROL",
            "None of the " + std::to_string(charts) +
                " control charts shows a pattern that chance makes seldom."};
  if (!trend.beyond_chance) return {"undecided", "AS BY CHANCE", chance};
  return {"fail", "OUT OF CONTROL", chance};
}

std::string figures(const Series& series, const Trend& trend) {
  size_t counting = 0, drifting = 0;
  for (const SeriesRun& run : series.runs) counting += run.doubt.empty();
  const ControlChart* worst = nullptr;
  for (const auto* charts : {&trend.faces, &trend.regions})
    for (const ControlChart& c : *charts) {
      drifting += c.drift.significant;
      if (!worst || ppk_of(c) < ppk_of(*worst)) worst = &c;
    }
  const auto of = [](size_t n, size_t all) { return std::to_string(n) + " / " + std::to_string(all); };
  const bool told = worst && std::isfinite(worst->capability.ppk.value);
  return "<section class=\"figures card\">" +
         series::figure(
             "Runs that count", of(counting, series.runs.size()),
             series.runs.front().created.substr(0, 10) + " to " + series.runs.back().created.substr(0, 10)) +
         series::figure("Faces in control",
                        of(trend.faces.size() - signalling(trend.faces), trend.faces.size()), "") +
         series::figure("Regions in control",
                        of(trend.regions.size() - signalling(trend.regions), trend.regions.size()), "") +
         series::figure("Worst Ppk", told ? fixed(worst->capability.ppk.value, 2) : "\u2013",
                        told ? escaped(worst->name) : "") +
         series::figure("Drifting", std::to_string(drifting), "95\u202f% interval without 0") +
         "</section>\n";
}

std::string run_table(const Series& series) {
  std::string html =
      "<div class=\"defects card\"><table><thead><tr><th "
      "class=\"n\">Run</th><th>Name</th><th>Date</th><th>Verdict</th>"
      "<th class=\"n\">Tolerance<br>mm</th><th>Counts</th></tr></thead><tbody>\n";
  for (size_t r = 0; r < series.runs.size(); ++r) {
    const SeriesRun& run = series.runs[r];
    html += (run.doubt.empty() ? "<tr>" : "<tr class=\"left-out\">") + cell(std::to_string(r + 1)) +
            cell(escaped(run.name), "text") + cell(escaped(run.created), "text") +
            cell(std::string(to_string(run.verdict)), "text") + cell("\u00b1" + fixed(run.tolerance_mm, 3)) +
            cell(run.doubt.empty() ? "yes" : "no: " + escaped(run.doubt), "text") + "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

std::string notes(const TrendOptions& options) {
  const std::string rules = options.rules == ControlRules::kLimits ? "only the limits themselves"
                            : options.rules == ControlRules::kWesternElectric
                                ? "Western Electric\u2019s four rules"
                                : "Nelson\u2019s eight rules";
  return "<div class=\"notes card\">"
         "<p><b>Charts.</b> Each point is the " +
         std::string(to_string(options.figure)) +
         " deviation of one face or region in one run. Limits are three short-term \u03c3 from the mean, "
         "\u03c3 = mean "
         "moving range / 1.128 (individuals and moving range)" +
         (options.baseline > 0 ? ", from the first " + std::to_string(options.baseline) + " runs that count"
                               : ", from all runs that count") +
         ". Signals: " + rules +
         ", and jumps beyond 3.267 mean moving ranges.</p>"
         "<p><b>In control is not in tolerance.</b> A chart asks whether the process is steady; Cpk and Ppk "
         "ask whether "
         "it fits the tolerance. Cpk takes the short-term \u03c3, Ppk all of the spread: Ppk far below Cpk "
         "is a process "
         "that wanders.</p>"
         "<p><b>Chance.</b> Many charts are looked at together. How many of a steady process would signal "
         "all the same "
         "is simulated, with limits from as few runs as these.</p>"
         "<p><b>Measurement.</b> u is the standard uncertainty of one value. Where it is near \u03c3 the "
         "chart shows "
         "mostly the measurement; a gauge study (gantry-fusion trend --gauge) tells them apart.</p>"
         "<p><b>Left out.</b> Runs that are UNDECIDED or whose registration is not trusted are drawn hollow "
         "and enter "
         "no limit, rule or index.</p></div>\n";
}

}  // namespace

std::filesystem::path write_trend(const std::filesystem::path& folder, const Series& series,
                                  const Trend& trend, const TrendOptions& options, const std::string& created,
                                  const std::string& software) {
  const bool simulated =
      std::any_of(series.runs.begin(), series.runs.end(), [](const SeriesRun& run) { return run.simulated; });
  std::string body = figures(series, trend);
  for (const std::string& warning : series.warnings)
    body += "<p class=\"lead\">Note: " + escaped(warning) + ".</p>\n";
  const Charts faces = by_urgency(trend.faces), regions = by_urgency(trend.regions);
  if (!faces.empty())
    body += section("Faces of the CAD model", "What asks for attention comes first.",
                    table(faces, faces.size()) + chart_grid(faces, kMostFaceCharts, series));
  if (!regions.empty())
    body += section("Regions of the surface", "Tiles of about equal size, the most urgent ones.",
                    table(regions, kMostRegionRows) + chart_grid(regions, kMostRegionCharts, series));
  body += section(
      "All features in all runs",
      "Deviation in the colours of the inspection report: green as designed, red too much material, blue too "
      "little; pale: the run does not count. Names in red: out of control.",
      "<div class=\"card heat-box\">" + series::heat_map_svg(trend.faces, series) +
          series::heat_map_svg(trend.regions, series) + "</div>");
  body += section("Runs", "In the order of their dates.", run_table(series));
  body += section("How to read this page", escaped(software), notes(options));
  const std::string title = series.runs.front().part.empty() ? "Untitled part" : series.runs.front().part;
  const std::string date =
      (simulated ? "<span class=\"simulated\">SIMULATED</span><br>no real part was measured<br>"
                 : std::string()) +
      "<time>" + escaped(created) + "</time>";
  return series::write_both(folder, "trend",
                            series::page("Trend over " + std::to_string(series.runs.size()) + " runs", title,
                                         date, banner_of(trend), body),
                            trend_json(series, trend, options, created, software));
}

}  // namespace gantry
