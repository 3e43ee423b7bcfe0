#include <algorithm>
#include <cmath>
#include <cstdio>

#include "report/text.h"
#include "series/charts.h"
#include "series/page_frame.h"

namespace gantry {
namespace {

using report::escaped;
using report::fixed;
using series::cell;
using series::estimate_text;

constexpr size_t kMostBars = 40, kMostCharts = 12;

using Results = std::vector<const GaugeResult*>;

/// Faces and regions together, the worst first.
Results by_grr(const GaugeReport& report) {
  Results results;
  for (const auto* list : {&report.faces, &report.regions})
    for (const GaugeResult& r : *list) results.push_back(&r);
  std::stable_sort(results.begin(), results.end(), [](const GaugeResult* a, const GaugeResult* b) {
    return a->percent_tolerance.value > b->percent_tolerance.value;
  });
  return results;
}

std::string chip(const std::string& words) {
  const std::string style = words == "acceptable" ? "good" : words == "conditional" ? "fair" : "poor";
  return words.empty() ? "\u2013" : "<span class=\"chip " + style + "\">" + words + "</span>";
}

std::string table(const Results& results) {
  std::string html =
      "<div class=\"defects card\"><table><thead><tr><th>Feature</th><th "
      "class=\"n\">Repeatability<br>mm</th>"
      "<th class=\"n\">Reproducibility<br>mm</th><th class=\"n\">Parts<br>mm</th><th class=\"n\">% of "
      "tolerance<br>"
      "95\u202f% interval</th><th class=\"n\">% of study<br>95\u202f% interval</th><th class=\"n\">ndc</th>"
      "<th class=\"n\">Interaction<br>p</th><th>By tolerance</th></tr></thead><tbody>\n";
  for (const GaugeResult* r : results)
    html += "<tr>" + series::feature_cell(r->name, r->words) + cell(fixed(r->ev_mm.value, 4)) +
            cell(fixed(r->av_mm.value, 4)) + cell(fixed(r->pv_mm.value, 4)) +
            cell(estimate_text(r->percent_tolerance, 1)) + cell(estimate_text(r->percent_study, 1)) +
            cell(fixed(r->ndc.value, 0)) +
            cell(r->interaction.freedoms > 0 ? fixed(r->interaction_p, 2) + (r->pooled ? " pooled" : "")
                                             : "\u2013") +
            "<td>" + chip(gauge_words(r->percent_tolerance.value)) + "</td></tr>\n";
  return html + "</tbody></table></div>\n";
}

std::string appraiser_key(const GaugeReport& report) {
  if (report.appraisers.size() < 2) return {};
  std::string html = "<p class=\"key-row\">";
  for (size_t a = 0; a < report.appraisers.size(); ++a)
    html += "<span><i style=\"background:var(--a" + std::to_string(a % 6) + ")\"></i>" +
            escaped(report.appraisers[a]) + "</span>";
  return html + "</p>\n";
}

std::string notes(const GaugeReport& report) {
  std::string html =
      "<div class=\"notes card\"><p><b>Method.</b> Analysis of variance (AIAG, Measurement Systems Analysis, "
      "4th "
      "edition): ";
  if (report.parts.size() > 1 && report.appraisers.size() > 1) {
    html +=
        "parts and appraisers crossed. An interaction with p above 0.25 is pooled with the repeatability.";
  } else {
    html += "repeated measurements of " +
            std::string(report.parts.size() > 1 ? "several parts" : "one part") + " by " +
            (report.appraisers.size() > 1 ? "several appraisers." : "one appraiser.");
  }
  html += "</p>";
  if (report.appraisers.size() < 2)
    html +=
        "<p><b>One appraiser.</b> What changes from operator to operator or from cell to cell is not in "
        "these "
        "figures.</p>";
  if (report.parts.size() < 2)
    html +=
        "<p><b>One part.</b> How much parts differ is not known, so there is no % of study and no ndc.</p>";
  return html +
         "<p><b>% of tolerance.</b> 6 GRR over the width of the tolerance: what counts where the measurement "
         "decides on "
         "PASS or FAIL. <b>% of study.</b> GRR over the total spread: what counts where it is to show "
         "changes of the "
         "process. Under 10\u202f% acceptable, to 30\u202f% conditional, beyond it not acceptable.</p>"
         "<p><b>ndc.</b> 1.41 part spread / GRR: how many groups of parts can be told apart; 5 or more are "
         "asked "
         "for.</p>"
         "<p><b>Intervals</b> hold the true value with 95\u202f% (generalised intervals). Few parts or "
         "appraisers leave "
         "them wide: ten parts, three appraisers and three trials are usual.</p></div>\n";
}

series::Banner banner_of(const GaugeReport& report, const Results& results) {
  size_t conditional = 0, poor = 0;
  for (const GaugeResult* r : results) {
    const std::string words = gauge_words(r->percent_tolerance.value);
    conditional += words == "conditional";
    poor += words == "not acceptable";
  }
  char text[220];
  std::snprintf(
      text, sizeof text,
      "Worst: %.60s, %.1f %% of the tolerance of \u00b1%.3g mm. Of %zu features %zu are acceptable, %zu "
      "conditional, %zu not acceptable.",
      results.front()->name.c_str(), results.front()->percent_tolerance.value, report.tolerance_mm,
      results.size(), results.size() - conditional - poor, conditional, poor);
  if (poor > 0) return {"fail", "NOT ACCEPTABLE", text};
  if (conditional > 0) return {"undecided", "CONDITIONAL", text};
  return {"pass", "ACCEPTABLE", text};
}

std::string figures(const GaugeReport& report, const Results& results) {
  double repeatability = 0, reproducibility = 0, least = 1e9;
  for (const GaugeResult* r : results) {
    repeatability = std::max(repeatability, r->ev_mm.value);
    if (std::isfinite(r->av_mm.value)) reproducibility = std::max(reproducibility, r->av_mm.value);
    if (std::isfinite(r->ndc.value)) least = std::min(least, r->ndc.value);
  }
  return "<section class=\"figures card\">" +
         series::figure("Parts", std::to_string(report.parts.size()), "") +
         series::figure("Appraisers", std::to_string(report.appraisers.size()), "operators or cells") +
         series::figure("Trials", std::to_string(report.trials), "of each") +
         series::figure("Largest repeatability", fixed(1000 * repeatability, 1) + "\u202f\u00b5m",
                        "standard deviation") +
         series::figure("Least ndc", least < 1e9 ? fixed(least, 0) : "\u2013", "5 or more are asked for") +
         "</section>\n";
}

std::string section(const std::string& title, const std::string& lead, const std::string& content) {
  return "<section><h2>" + title + "</h2><p class=\"lead\">" + lead + "</p>\n" + content + "</section>\n";
}

}  // namespace

std::filesystem::path write_gauge(const std::filesystem::path& folder, const GaugeReport& report,
                                  const std::string& created, const std::string& software) {
  const Results results = by_grr(report);
  std::string body = figures(report, results);
  for (const std::string& warning : report.warnings)
    body += "<p class=\"lead\">Note: " + escaped(warning) + ".</p>\n";
  const Results bars(results.begin(),
                     results.begin() + static_cast<std::ptrdiff_t>(std::min(kMostBars, results.size())));
  body += section("Share of the tolerance", "The worst features first.",
                  "<div class=\"card heat-box\">" + series::gauge_bars_svg(bars) + "</div>");
  std::string charts = appraiser_key(report) + "<div class=\"charts\">";
  for (size_t i = 0; i < std::min(kMostCharts, results.size()); ++i)
    charts += "<figure class=\"card control-box\"><figcaption><b>" + escaped(results[i]->name) +
              "</b><span>" + escaped(results[i]->words) + "</span></figcaption>" +
              series::gauge_points_svg(*results[i], report) + "</figure>\n";
  body += section("Measurements", "Every measurement (mm), and the mean of each part by each appraiser.",
                  charts + "</div>");
  body += section("All features", "Standard deviations.", table(results));
  if (!report.unseen.empty())
    body += "<p class=\"lead\">" + std::to_string(report.unseen.size()) +
            " features were not seen by all runs and are left out.</p>\n";
  body += section("How to read this page", escaped(software), notes(report));
  return series::write_both(
      folder, "gauge",
      series::page("Gauge repeatability and reproducibility", report.study.name,
                   "<time>" + escaped(created) + "</time>", banner_of(report, results), body),
      gauge_json(report, created, software));
}

}  // namespace gantry
