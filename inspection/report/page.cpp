#include "report/page.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "report/charts.h"
#include "report/defect_tables.h"
#include "report/page_parts.h"
#include "report/text.h"
#include "report/web_files.h"

namespace gantry::report {
namespace {

/// "2026-05-04T10:20:30Z" with a space instead of the T.
std::string date_text(std::string created) {
  if (created.size() > 10 && created[10] == 'T') created[10] = ' ';
  return escaped(created);
}

std::string title_of(const PageContent& c) {
  return c.traceability.title.empty() ? std::string("Untitled part") : c.traceability.title;
}

std::string heading(const PageContent& c) {
  return "<header><div><div class=\"kicker\">Dimensional inspection report</div><h1>" + escaped(title_of(c)) +
         "</h1></div><div class=\"date\"><button id=\"theme\" type=\"button\" hidden>Dark</button>" +
         (c.traceability.simulated
              ? "<span class=\"simulated\">SIMULATED</span><br>no real part was measured<br>"
              : std::string()) +
         "<time>" + date_text(c.traceability.created) + "</time></div></header>\n";
}

std::string verdict(const PageContent& c) {
  std::string style, icon;
  switch (c.result.verdict) {
    case Verdict::kPass:
      style = "pass", icon = "<path d=\"M10 20l7 7 13-15\"/>";
      break;
    case Verdict::kFail:
      style = "fail", icon = "<path d=\"M12 12l16 16M28 12L12 28\"/>";
      break;
    case Verdict::kUndecided:
      style = "undecided";
      icon = "<path d=\"M14.5 15.5a5.5 5.5 0 1 1 8.3 4.7c-2 1.2-2.8 2-2.8 4\"/><path d=\"M20 29v.1\"/>";
      break;
  }
  return "<section class=\"verdict card " + style +
         "\"><div class=\"badge-box\"><svg viewBox=\"0 0 40 40\" aria-hidden=\"true\">" +
         "<circle cx=\"20\" cy=\"20\" r=\"17.5\"/>" + icon + "</svg>" +
         std::string(to_string(c.result.verdict)) + "</div><div class=\"reason\">" +
         escaped(c.result.reason) + "</div></section>\n";
}

std::string figures(const PageContent& c) {
  const DeviationStatistics& s = c.result.statistics;
  const bool any = s.count > 0;
  const auto certain = std::count_if(c.result.defects.begin(), c.result.defects.end(),
                                     [](const Defect& d) { return d.certain; });
  const auto figure = [](const std::string& name, const std::string& value, const std::string& note) {
    return "<div><span>" + name + "</span><b>" + value + "</b><span>" + note + "</span></div>";
  };
  return "<section class=\"figures card\">" +
         figure("Tolerance", "\u00b1" + mm(c.options.tolerance_mm), "on the CAD surface") +
         figure("Within tolerance", any ? percent(s.within_tolerance) : "\u2013",
                "of " + grouped(s.count) + " points") +
         figure("Mean \u00b1 \u03c3", any ? with_sign(s.mean, 3) + " \u00b1 " + fixed(s.sigma, 3) : "\u2013",
                "mm, all judged points") +
         figure("Surface seen", percent(c.result.coverage), "of the CAD model") +
         figure("Defects", std::to_string(c.result.defects.size()),
                c.result.defects.empty() ? "none out of tolerance" : std::to_string(certain) + " certain") +
         "</section>\n";
}

std::string deviation_views(const PageContent& c, const ColourScale& colours) {
  std::string html =
      "<section><h2>Deviation from the CAD model</h2><p class=\"lead\">The CAD surface in the colours of the "
      "measured "
      "deviation. Numbers lead to the defects listed below.</p>\n<div class=\"scale card\">" +
      legend_svg(colours) +
      "<div class=\"keys\"><div><span class=\"swatch unseen\"></span><span>not seen: no judged point "
      "within " +
      mm(c.seen_reach_mm, 1) +
      "</span></div><div><span class=\"swatch outline\"></span><span>outline of a "
      "defect</span></div></div></div>\n" +
      viewer_section(c) + "<div class=\"views\">";
  for (size_t i = 0; i < c.overviews.size(); ++i)
    html += "<figure class=\"card\"><figcaption>" + escaped(c.overviews[i].name) + "</figcaption>" +
            picture_svg(c.overviews[i], "view-" + std::to_string(i + 1)) + "</figure>\n";
  return html + "</div></section>\n";
}

std::string traceability(const PageContent& c) {
  std::string html =
      "<section><h2>Traceability</h2><div class=\"panel card\" style=\"margin-top:14px\"><table><tbody>" +
      row("Part", escaped(title_of(c)), "text") + row("Created", date_text(c.traceability.created), "text") +
      row("Measurement", c.traceability.simulated ? "simulated: no real part was measured" : "real", "text");
  for (const auto& [name, value] : c.traceability.entries) html += row(escaped(name), escaped(value), "text");
  std::string mesh = grouped(c.facts.triangles) + " triangles, " + escaped(c.result.topology.text());
  if (c.result.beside_border > 0)
    mesh += "; " + grouped(c.result.beside_border) + " points lie beside its border and were not judged";
  html += row("Mesh of the CAD model", mesh, "text");
  return html + "</tbody></table></div></section>\n";
}

std::string notes(const PageContent& c) {
  const InspectionOptions& o = c.options;
  std::string html = "<section><h2>How to read this report</h2><div class=\"notes card\">";
  html +=
      "<p><b>Sign.</b> A deviation is the signed distance of the measured surface to the closest CAD "
      "surface. "
      "Positive, towards red: too much material. Negative, towards blue: material is missing. Green: as "
      "designed.</p>";
  html +=
      "<p><b>Smoothing.</b> Before it is measured, each point is moved onto the surface through its "
      "neighbours within " +
      mm(o.averaging_radius_mm, 2) +
      " (at least twice the spacing of the points): a plane, or a quadratic where they are curved. Points on "
      "sharp edges, where no smooth surface fits, are not judged.</p>";
  html +=
      "<p><b>Tolerance and verdict.</b> Deviations within \u00b1" + mm(o.tolerance_mm) +
      " are good. A connected region beyond it of at least " + fixed(o.min_defect_area_mm2, 1) +
      "\u202fmm\u00b2 is a defect. It is certain when its peak exceeds the tolerance by more than the guard "
      "band, " +
      fixed(o.guard_band, 2) +
      " standard uncertainties (ISO 14253-1); a region that comes as near from "
      "within is in doubt. Where that cannot be told, or when less than " +
      percent(o.min_coverage) + " of the surface was seen, the verdict is UNDECIDED.</p>";
  html +=
      "<p><b>What is not judged.</b> " + grouped(count_of(c.result, PointClass::kFixture)) +
      " points belong to the fixture or lie too close to it to tell; " +
      grouped(count_of(c.result, PointClass::kFar)) + " lie further than " + mm(o.max_distance_mm, 1) +
      " from any surface of the part. Surface hatched in grey was not seen: nothing is claimed about it.</p>";
  html +=
      "<p><b>Pictures.</b> Deviations are drawn on the CAD surface, and colours end at twice the tolerance. "
      "Measured "
      "material where the CAD model has none, such as a hole that was not drilled, is drawn where it was "
      "measured. Close-ups look straight at the defect; what stands before it is cut away, and the cut is "
      "dark grey.</p>";
  html +=
      "<p><b>Data.</b> report.json holds the numbers of this page; deviations.ply holds every measured point "
      "in the frame "
      "of the CAD model with its deviation, its standard uncertainty and the number of its defect.</p>";
  return html + "</div></section>\n";
}

}  // namespace

std::string page(const PageContent& c) {
  const ColourScale colours(c.options.tolerance_mm);
  return "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         std::string(to_string(c.result.verdict)) + " \u00b7 " + escaped(title_of(c)) +
         " \u00b7 inspection report</title>\n<style>" + kPageCss + "</style>\n</head>\n<body>\n<main>\n" +
         heading(c) + verdict(c) + figures(c) + deviation_views(c, colours) + defect_table(c) +
         unjudged_tables(c) + cuts_section(c, colours) + coverage_section(c) +
         distribution_section(c, colours) + traceability(c) + notes(c) +
         "<footer>Gantry inspection report. One file, nothing is loaded from "
         "elsewhere.</footer>\n</main>\n<script>\n" +
         kThemeJs + "</script>\n<script id=\"viewer-data\" type=\"application/json\">" + c.viewer_data +
         "</script>\n<script>\n" + kViewerJs + "</script>\n</body>\n</html>\n";
}

}  // namespace gantry::report
