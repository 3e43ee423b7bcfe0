#include "report/defect_tables.h"

#include <algorithm>
#include <cmath>

#include "report/page_parts.h"
#include "report/text.h"

namespace gantry::report {
namespace {

constexpr size_t kMostDefectRows = 100;
constexpr size_t kMostUnjudgedRows = 20;

std::string vector_text(const Eigen::Vector3d& v) {
  return fixed(v.x(), 1) + "&ensp;" + fixed(v.y(), 1) + "&ensp;" + fixed(v.z(), 1);
}

std::string area_text(double mm2) {
  return fixed(mm2, mm2 < 100 ? 1 : 0);
}

/// Too much and too little, each where there is any.
std::string volume_text(const Defect& d) {
  constexpr double kNone = 0.05;
  std::string text = d.extra_mm3 >= kNone ? "+" + area_text(d.extra_mm3) : std::string();
  if (d.missing_mm3 >= kNone) text += (text.empty() ? "" : "<br>") + ("\u2212" + area_text(d.missing_mm3));
  return text.empty() ? "\u2013" : text;
}

std::string cell(const std::string& text) {
  return "<td class=\"n\">" + text + "</td>";
}

/// Two lines: a name, and smaller what it is.
std::string named_cell(const std::string& name, const std::string& words) {
  return "<td><b>" + escaped(name) + "</b>" +
         (words.empty() ? "" : "<br><small>" + escaped(words) + "</small>") + "</td>";
}

std::string certainty_chip(const Defect& d, double tolerance_mm) {
  if (d.kind == DefectClass::kRegistrationResidue) return "<span class=\"chip no\">measure again</span>";
  if (d.certain) return "<span class=\"chip yes\">certain</span>";
  return std::abs(d.peak_mm) > tolerance_mm ? "<span class=\"chip no\">within guard band</span>"
                                            : "<span class=\"chip no\">in doubt</span>";
}

std::string defect_row(const Defect& d, double tolerance_mm) {
  const bool out = std::abs(d.peak_mm) > tolerance_mm;  // those in doubt have no number
  return (out ? "<tr id=\"defect-" + std::to_string(d.id) + "\"><td class=\"n no\">" + std::to_string(d.id)
              : std::string("<tr><td class=\"n no\">")) +
         "</td>" + named_cell(std::string(to_string(d.kind)), d.words) +
         cell("<b>" + with_sign(d.peak_mm, 3) + "</b> \u00b1 " + fixed(d.uncertainty_mm, 3)) +
         cell(with_sign(d.signed_mean_mm, 3) + " \u00b1 " + fixed(d.mean_uncertainty_mm, 3)) +
         cell(area_text(d.area_mm2)) + cell(volume_text(d)) + named_cell(d.face, d.face_words) +
         cell(vector_text(d.centre_mm) + "<br>" + vector_text(d.extent_mm)) + cell(grouped(d.points)) +
         "<td>" + certainty_chip(d, tolerance_mm) + "</td></tr>\n";
}

}  // namespace

std::string defect_table(const PageContent& c) {
  const auto& defects = c.result.defects;
  std::string html = "<section><h2>Defects</h2>";
  const auto& doubtful = c.result.doubtful;
  if (defects.empty() && doubtful.empty())
    return html + "<div class=\"none card\">" +
           (c.result.statistics.count > 0
                ? "No region of the judged surface is out of tolerance, nor in doubt."
                : "No point was judged, so no defect could be found.") +
           "</div></section>\n";
  html +=
      "<p class=\"lead\">Connected regions out of tolerance, largest deviation first; then those in "
      "tolerance "
      "by less than the guard band. Positions in the frame of the CAD model.</p>\n<div class=\"defects "
      "card\"><table><thead><tr><th "
      "class=\"n\">No.</th><th>Class</th>"
      "<th class=\"n\">Peak \u00b1 U<br>mm</th><th class=\"n\">Mean \u00b1 U<br>mm</th>"
      "<th class=\"n\">Area<br>mm\u00b2</th><th class=\"n\">Volume<br>mm\u00b3</th><th>CAD face</th>"
      "<th class=\"n\">Centre x&ensp;y&ensp;z<br>Extent x&ensp;y&ensp;z, mm</th>"
      "<th class=\"n\">Points</th><th>Certainty</th></tr></thead><tbody>\n";
  for (const auto* regions : {&defects, &doubtful})
    for (size_t i = 0; i < std::min(regions->size(), kMostDefectRows); ++i)
      html += defect_row((*regions)[i], c.options.tolerance_mm);
  html += "</tbody></table></div>\n";
  if (defects.size() > kMostDefectRows)
    html += "<p class=\"lead\">" + std::to_string(defects.size() - kMostDefectRows) +
            " smaller ones are listed in report.json only.</p>\n";
  html += "<div class=\"close-ups\">";
  for (size_t i = 0; i < c.close_ups.size(); ++i)
    html += "<figure class=\"card\"><figcaption><b>" + escaped(c.close_ups[i].name) + "</b><span>" +
            signed_mm(defects[i].peak_mm) + "</span></figcaption>" +
            picture_svg(c.close_ups[i], "close-up-" + std::to_string(defects[i].id)) + "</figure>\n";
  html += "</div>\n";
  if (defects.size() > c.close_ups.size())
    html += "<p class=\"lead\">Pictures of the " + std::to_string(c.close_ups.size()) + " largest of " +
            std::to_string(defects.size()) + " defects.</p>\n";
  return html + "</section>\n";
}

std::string unjudged_tables(const PageContent& c) {
  const InspectionResult& r = c.result;
  std::string html = "<section><h2>No data, and the fixture</h2>";
  if (r.unseen.empty() && r.fixture_regions.empty())
    return html + "<div class=\"none card\">No connected piece of the CAD surface of " +
           fixed(c.options.min_unseen_area_mm2, 0) +
           "\u202fmm\u00b2 or more is without data.</div></section>\n";
  html += "<p class=\"lead\">CAD surface that no judged point covers: " +
          grouped(static_cast<size_t>(r.unseen_mm2 + 0.5)) + "\u202fmm\u00b2, its pieces of " +
          fixed(c.options.min_unseen_area_mm2, 0) +
          "\u202fmm\u00b2 or more below. Nothing is claimed about it. What was found of the fixture is not "
          "judged.</p>\n<div class=\"defects card\"><table><thead><tr><th>Class</th><th "
          "class=\"n\">Area<br>mm\u00b2</th><th>CAD face</th><th class=\"n\">Share<br>of it</th><th "
          "class=\"n\">Centre x&ensp;y&ensp;z<br>mm</th><th class=\"n\">Extent x&ensp;y&ensp;z<br>mm</th>"
          "<th></th></tr></thead><tbody>\n";
  for (const auto* regions : {&r.unseen, &r.fixture_regions}) {
    for (size_t i = 0; i < std::min(regions->size(), kMostUnjudgedRows); ++i) {
      const UnjudgedRegion& u = (*regions)[i];
      const bool unseen = u.kind == DefectClass::kNoData;
      html += "<tr>" + named_cell(std::string(to_string(u.kind)), "") + cell(area_text(u.area_mm2)) +
              named_cell(u.face, u.face_words) + cell(unseen ? percent(u.face_share, 0) : "") +
              cell(vector_text(u.centre_mm)) + cell(vector_text(u.extent_mm)) + "<td>" +
              (!unseen            ? grouped(u.points) + " points"
               : u.behind_fixture ? "at the fixture"
                                  : "not seen") +
              "</td></tr>\n";
    }
    if (regions->size() > kMostUnjudgedRows)
      html += "<tr><td colspan=\"7\">" + std::to_string(regions->size() - kMostUnjudgedRows) +
              " smaller ones are listed in report.json only.</td></tr>\n";
  }
  return html + "</tbody></table></div></section>\n";
}

}  // namespace gantry::report
