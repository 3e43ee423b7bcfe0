#include "report/page_parts.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "report/charts.h"
#include "report/section_chart.h"
#include "report/text.h"

namespace gantry::report {
namespace {

/// "-x" with a true minus.
std::string axis_words(const std::string& towards) {
  return (towards[0] == '-' ? "\u2212" : "+") + towards.substr(1);
}

/// What brought the cloud into the frame of the CAD model.
std::string alignment_panel(const PageContent& c) {
  const AlignmentResult& a = c.result.alignment;
  std::string html = "<div class=\"panel card\"><h3>Alignment to the CAD model</h3><table><tbody>";
  if (c.options.align) {
    const Eigen::Vector3d angle = rotation_log(a.cad_from_cloud.linear()) * 180 / std::numbers::pi;
    const Eigen::Vector3d move = a.cad_from_cloud.translation();
    const auto deviation = [&](int i) { return std::sqrt(std::max(0.0, a.covariance(i, i))); };
    const auto three = [](const Eigen::Vector3d& v) {
      return with_sign(v.x(), 3) + "&ensp;" + with_sign(v.y(), 3) + "&ensp;" + with_sign(v.z(), 3);
    };
    const auto three_sizes = [](double x, double y, double z, int decimals) {
      return fixed(x, decimals) + "&ensp;" + fixed(y, decimals) + "&ensp;" + fixed(z, decimals);
    };
    std::string method = a.datums.empty() ? "robust best fit" : "datums, by precedence:";
    for (const DatumFit& datum : a.datums) method += " " + escaped(datum.name);
    if (c.options.alignment.from_any_start) method += ", from any start";
    html += row("Method", method) +
            row("Converged", a.converged ? "yes, " + std::to_string(a.iterations) + " iterations" : "no") +
            row("Residual before \u2192 after (rms)", mm(a.rms_before_mm) + " \u2192 " + mm(a.rms_after_mm)) +
            row("Inliers", percent(a.inlier_fraction)) + row("Translation x y z", three(move) + "\u202fmm") +
            row("Its standard uncertainty",
                three_sizes(deviation(3), deviation(4), deviation(5), 4) + "\u202fmm") +
            row("Rotation vector x y z", three(angle) + "\u202f\u00b0") +
            row("Its standard uncertainty",
                three_sizes(deviation(0) * 180 / std::numbers::pi, deviation(1) * 180 / std::numbers::pi,
                            deviation(2) * 180 / std::numbers::pi, 4) +
                    "\u202f\u00b0");
    if (a.masked_regions > 0)
      html += row("Left out as no noise", percent(a.masked_fraction) + " of the points, " +
                                              std::to_string(a.masked_regions) + " regions");
    for (const DatumFit& datum : a.datums)
      html += row("Datum " + escaped(datum.name), escaped(datum.words) + ", rms " + mm(datum.rms_mm));
    for (const FreeMotion& motion : a.free_motions) html += row("Not held", escaped(motion.words));
    for (const EquivalentPose& pose : a.equivalents) html += row("Fits as well", escaped(pose.words));
  } else {
    html += row("Method", "none: the cloud is taken as it stands");
  }
  return html + "</tbody></table></div>";
}

/// What the deviations are uncertain by.
std::string uncertainty_panel(const PageContent& c) {
  const UncertaintyBudget& u = c.result.budget;
  return "<div class=\"panel card\"><h3>Uncertainty of a typical deviation</h3><table><tbody>" +
         row("Expanded (95\u202f%)", "\u00b1" + mm(kCoverageFactor95 * u.combined(), 4)) +
         row("Standard: noise of the sensor, after smoothing", mm(u.noise, 4)) +
         row("Poses of the scans, registered",
             c.result.poses_known ? mm(u.scan_poses, 4) : "not known: the cloud does not name its scans") +
         row("Alignment to the CAD model", mm(u.alignment, 4)) +
         row("Sensor, common to neighbouring points", mm(u.sensor, 4)) +
         "</tbody></table><p class=\"fine\">Medians over the judged points; every point has its own, in "
         "deviations.ply and in the table of defects.</p></div>\n";
}

}  // namespace

std::string percent(double fraction, int decimals) {
  const double scale = std::pow(10.0, decimals);
  return fixed(std::floor(fraction * 100 * scale + 1e-6) / scale, decimals) + "\u202f%";
}

std::string mm(double value, int decimals) {
  return fixed(value, decimals) + "\u202fmm";
}
std::string signed_mm(double value) {
  return with_sign(value, 3) + "\u202fmm";
}

std::string row(const std::string& name, const std::string& value, const std::string& style) {
  return "<tr><th scope=\"row\">" + name + "</th><td class=\"" + style + "\">" + value + "</td></tr>\n";
}

size_t count_of(const InspectionResult& result, PointClass point_class) {
  return static_cast<size_t>(std::count(result.point_class.begin(), result.point_class.end(), point_class));
}

std::string viewer_section(const PageContent& c) {
  const auto button = [](const std::string& kind, const std::string& value, const std::string& text) {
    return "<button type=\"button\" data-" + kind + "=\"" + value + "\">" + text + "</button>";
  };
  const Camera& still = c.overviews.front().camera;
  std::string html =
      "<figure class=\"viewer card\"><figcaption><b>Interactive view</b><span id=\"viewer-note\">"
      "A still picture stands in for it where scripts do not run.</span></figcaption>";
  html += "<div id=\"viewer-tools\" hidden>" + button("view", "iso", "Isometric");
  for (const auto& [value, text] : {std::pair{"front", "Front"},
                                    {"back", "Back"},
                                    {"left", "Left"},
                                    {"right", "Right"},
                                    {"top", "Top"},
                                    {"bottom", "Bottom"}})
    html += button("view", value, text);
  html += "<span class=\"gap\"></span>" + button("zoom", "0.7", "<span aria-label=\"Zoom in\">+</span>") +
          button("zoom", "1.43", "<span aria-label=\"Zoom out\">\u2212</span>") +
          "<label><input type=\"checkbox\" id=\"viewer-sections\"> Sections</label></div>";
  return html + "<div id=\"viewer-stage\"><svg class=\"still\" viewBox=\"0 0 " + std::to_string(still.width) +
         " " + std::to_string(still.height) + "\"><use href=\"#view-1\" width=\"" +
         std::to_string(still.width) + "\"/></svg></div></figure>\n";
}

std::string cuts_section(const PageContent& c, const ColourScale& colours) {
  std::string html = "<section class=\"cuts\"><h2>Sections</h2>";
  if (c.facts.sections.empty())
    return html + "<div class=\"none card\">No plane through the part meets its surface.</div></section>\n";
  html +=
      "<p class=\"lead\">Planes through the part: the nominal outline with what was measured beside it, "
      "deviations "
      "drawn too large by the factor that is stated.</p>\n<div class=\"views\">";
  for (const Section& section : c.facts.sections) {
    const SectionStatistics s = section_statistics(section);
    const std::string times = fixed(exaggeration(section, c.options.tolerance_mm), 0);
    html += "<figure class=\"card\"><figcaption><b>" + escaped(section_name(section)) +
            "</b><span>deviations \u00d7\u202f" + times + "</span></figcaption>" +
            section_svg(section, colours) + "<p class=\"fine\">" +
            (section.through > 0 ? "Through defect " + std::to_string(section.through) + ". "
                                 : std::string("Through the middle of the part. "));
    if (s.count > 0) {
      html += "Measured: " + signed_mm(s.min) + " \u2026 " + signed_mm(s.max) + ", mean " +
              signed_mm(s.mean) + ".";
    } else {
      html += "Nothing was measured here.";
    }
    html += "</p></figure>\n";
  }
  html +=
      "<div class=\"card key\"><h3>How to read a section</h3>"
      "<div><svg viewBox=\"0 0 26 13\"><path class=\"nominal\" d=\"M1,6.5h24\"/></svg><span>nominal outline; "
      "the "
      "material is shaded</span></div>"
      "<div><svg viewBox=\"0 0 26 13\"><path class=\"band\" stroke-width=\"11\" d=\"M1,6.5h24\"/></svg><span>"
      "tolerance, \u00b1" +
      mm(c.options.tolerance_mm) +
      ", by the same factor</span></div>"
      "<div><svg viewBox=\"0 0 26 13\"><path class=\"measured\" stroke=\"" +
      hex(colours(colours.limit_mm())) +
      "\" d=\"M5,3h0M11,2h0M17,3h0M23,2h0\"/><path class=\"nominal\" d=\"M1,10h24\"/></svg><span>measured, "
      "in the "
      "colours of the deviation</span></div>"
      "<p class=\"fine\">What was measured within " +
      mm(c.facts.sections.front().slab_mm, 2) +
      " of a plane belongs to its section. Where the outline has no colour beside it, nothing was seen. "
      "Material that "
      "the CAD model does not have is drawn where it was measured.</p></div>";
  return html + "</div></section>\n";
}

std::string coverage_section(const PageContent& c) {
  const double unseen = 1 - c.result.coverage;
  std::string html =
      "<section><h2>Coverage</h2><p class=\"lead\">What of the CAD surface was seen. Nothing is claimed "
      "about the "
      "rest.</p>\n<div class=\"coverage\"><div class=\"panel card\"><h3>Seen and not seen</h3>"
      "<div class=\"keys\"><div><span class=\"swatch\" style=\"background:" +
      hex(kSeenColour) + "\"></span><span>seen: <b>" + percent(c.result.coverage) +
      "</b></span></div><div><span class=\"swatch unseen\"></span><span>not seen: <b>" +
      fixed(100 - std::floor(1e4 * c.result.coverage + 1e-6) / 100, 2) + "\u202f%</b>, " +
      fixed(unseen * c.facts.surface_mm2, 0) + " of " +
      grouped(static_cast<size_t>(std::llround(c.facts.surface_mm2))) +
      "\u202fmm\u00b2</span></div></div><table><thead><tr><th>Faces towards</th><th "
      "class=\"n\">mm\u00b2</th><th "
      "class=\"n\">seen</th></tr></thead><tbody>";
  for (const SideCoverage& side : c.facts.sides)
    if (side.area_mm2 > 0)
      html += "<tr><th scope=\"row\">" + axis_words(side.towards) + "</th><td class=\"n\">" +
              grouped(static_cast<size_t>(std::llround(side.area_mm2))) + "</td><td class=\"n\">" +
              percent(side.seen, 0) + "</td></tr>\n";
  html += "</tbody></table></div>\n<div class=\"sides\">";
  for (size_t i = 0; i < c.coverage_views.size(); ++i)
    html += "<figure class=\"card\"><figcaption>" + escaped(c.coverage_views[i].name) + "</figcaption>" +
            picture_svg(c.coverage_views[i], "coverage-" + std::to_string(i + 1)) + "</figure>\n";
  return html + "</div></div></section>\n";
}

std::string distribution_section(const PageContent& c, const ColourScale& colours) {
  const DeviationStatistics& s = c.result.statistics;
  const Distribution& d = c.facts.distribution;
  const auto value = [&](double v) { return s.count > 0 ? signed_mm(v) : std::string("\u2013"); };
  const auto size = [&](double v) { return s.count > 0 ? mm(v) : std::string("\u2013"); };
  std::string html = "<section><h2>Distribution of the deviations</h2><p class=\"lead\">";
  if (s.count > 0) {
    html +=
        "Dashed: Gaussian of all judged points. Solid: Gaussian of their bulk, from median and median "
        "absolute deviation, which defects hardly move.";
  } else {
    html += "No point was judged.";
  }
  html +=
      "</p>\n<div class=\"pair\"><div class=\"panel card\"><h3>Linear counts: how good the surface is</h3>" +
      histogram_svg(d, colours, CountAxis::kLinear) +
      "</div><div class=\"panel card\"><h3>Logarithmic counts: the few points of a defect</h3>" +
      histogram_svg(d, colours, CountAxis::kLogarithmic) + "</div></div>\n";

  const auto gaussian = [&](const Gaussian& g) {
    return s.count > 0 ? with_sign(g.mean_mm, 3) + " \u00b1 " + mm(g.sigma_mm) : std::string("\u2013");
  };
  html += "<div class=\"pair\"><div class=\"panel card\"><h3>Magnitudes, with their Weibull fit</h3>" +
          magnitudes_svg(d, colours) +
          "</div><div class=\"panel card\"><h3>Fits</h3><table><thead><tr><th></th><th "
          "class=\"n\">Parameters</th><th class=\"n\">Misfit</th></tr></thead><tbody>";
  const auto fit = [&](const std::string& name, const std::string& parameters, double misfit) {
    html += "<tr><th scope=\"row\">" + name + "</th><td class=\"n\">" + parameters + "</td><td class=\"n\">" +
            fixed(misfit, 3) + "</td></tr>\n";
  };
  fit("Gaussian, all points: mean \u00b1 \u03c3", gaussian(d.all), d.all_misfit);
  fit("Gaussian, bulk: median \u00b1 robust \u03c3", gaussian(d.bulk), d.bulk_misfit);
  fit("Weibull, magnitudes: shape, scale",
      d.weibull ? fixed(d.weibull->shape, 3) + ",&ensp;" + mm(d.weibull->scale_mm, 4) : std::string("\u2013"),
      d.weibull_misfit);
  html +=
      "</tbody></table><p class=\"fine\">Weibull by maximum likelihood. Misfit: the largest difference "
      "between "
      "the measured and the fitted share of points below any value (Kolmogorov and Smirnov); 0 is perfect. "
      "Surface with defects is a mixture, which no single distribution fits well.</p></div></div>\n";

  html +=
      "<div class=\"pair\"><div class=\"panel card\"><h3>Statistics of the judged points</h3><table><tbody>" +
      row("Mean", value(s.mean)) + row("Standard deviation \u03c3", size(s.sigma)) +
      row("Root mean square", size(s.rms)) +
      row("Least \u2026 greatest", value(s.min) + " \u2026 " + value(s.max)) +
      row("5th, 50th, 95th percentile", value(s.p05) + "&ensp;" + value(s.p50) + "&ensp;" + value(s.p95)) +
      row("Magnitude: 50th, 95th, 99th",
          mm(d.magnitude_p50_mm) + "&ensp;" + mm(d.magnitude_p95_mm) + "&ensp;" + mm(d.magnitude_p99_mm)) +
      row("Within tolerance", s.count > 0 ? percent(s.within_tolerance) : "\u2013") +
      row("Points judged", grouped(count_of(c.result, PointClass::kJudged))) +
      row("Points not judged: fixture", grouped(count_of(c.result, PointClass::kFixture))) +
      row("Points not judged: far from the part", grouped(count_of(c.result, PointClass::kFar))) +
      "</tbody></table></div>\n";
  return html + uncertainty_panel(c) + "</div>\n<div class=\"pair\">" + alignment_panel(c) +
         "</div></section>\n";
}

}  // namespace gantry::report
