#include "series/charts.h"

#include <algorithm>
#include <set>

#include "report/colour_scale.h"
#include "series/svg.h"

namespace gantry::series {
namespace {

using report::coordinate;
using report::escaped;
using report::fixed;
using report::with_sign;

/// A vertical axis: `low` at y_low, `high` at y_high.
struct Axis {
  double low, high, y_low, y_high;
  double operator()(double value) const {
    return y_low + (y_high - y_low) * (std::clamp(value, low, high) - low) / (high - low);
  }
};

/// Grid lines with their values, which are written by `words`.
template <typename Words>
std::string grid(const Axis& axis, double left, double right, int wanted, Words&& words) {
  std::string svg;
  const double step = round_step(axis.high - axis.low, wanted);
  for (double k = std::ceil(axis.low / step - 1e-9); k * step <= axis.high + 1e-9 * step; ++k) {
    svg += svg_line("grid", left, axis(k * step), right, axis(k * step));
    svg += svg_text(left - 7, axis(k * step) + 4, "end", words(k * step, decimals_of(step)));
  }
  return svg;
}

/// Runs named below a chart, no more than there is room for.
std::string run_numbers(size_t runs, double y, double to_x0, double step_x) {
  std::string svg;
  const size_t each = std::max<size_t>(1, static_cast<size_t>(std::ceil(22 / step_x)));
  for (size_t r = 0; r < runs; ++r)
    if ((r + 1) % each == 0 || (each > 1 && r == 0))
      svg += svg_text(to_x0 + step_x * static_cast<double>(r), y, "middle", std::to_string(r + 1));
  return svg;
}

std::string point_title(const Series& series, size_t run, double value) {
  const SeriesRun& r = series.runs[run];
  return "run " + std::to_string(run + 1) + ", " + escaped(r.name) + ": " + with_sign(value, 4) + " mm" +
         (r.doubt.empty() ? "" : " (does not count)");
}

}  // namespace

std::string control_chart_svg(const ControlChart& c, const Series& series) {
  constexpr double kWidth = 560, kLeft = 62, kRight = 46, kTop = 14, kMiddle = 190, kGap = 26, kFloor = 286;
  const size_t n = c.values.size();
  const double step_x = (kWidth - kLeft - kRight - 20) / std::max<double>(1, static_cast<double>(n) - 1);
  const double x0 = kLeft + 10, right = kWidth - kRight;
  const auto to_x = [&](size_t run) { return x0 + step_x * static_cast<double>(run); };
  double low = c.lower_mm, high = c.upper_mm, range_high = c.range_upper_mm;
  double tolerance = 0;
  for (size_t r = 0; r < n; ++r) {
    tolerance = series.runs[r].doubt.empty() ? series.runs[r].tolerance_mm : tolerance;
    if (!std::isfinite(c.values[r])) continue;
    low = std::min(low, c.values[r]);
    high = std::max(high, c.values[r]);
    if (std::isfinite(c.moving_ranges[r])) range_high = std::max(range_high, c.moving_ranges[r]);
  }
  const double span = std::max(high - low, 1e-6);
  const bool near_upper = tolerance<high + 0.5 * span, near_lower = -tolerance> low - 0.5 * span;
  if (near_upper) high = std::max(high, tolerance);
  if (near_lower) low = std::min(low, -tolerance);
  const double margin = 0.08 * std::max(high - low, 1e-6);
  const Axis values{low - margin, high + margin, kMiddle, kTop};
  const Axis ranges{0, 1.12 * std::max(range_high, 1e-6), kFloor, kMiddle + kGap};

  std::set<size_t> bad, bad_ranges;
  for (const ControlSignal& s : c.signals)
    for (size_t r = s.first; r <= s.last; ++r) {
      if (s.rule == "Moving range") {
        if (r == s.last) bad_ranges.insert(r);
      } else if (std::isfinite(c.values[r]) && series.runs[r].doubt.empty()) {
        bad.insert(r);
      }
    }

  std::string svg = "<svg class=\"chart control\" role=\"img\" aria-label=\"Control chart of " +
                    escaped(c.name) + "\" viewBox=\"0 0 560 318\">";
  svg += "<rect class=\"zone\" x=\"" + coordinate(kLeft) + "\" y=\"" + coordinate(values(c.upper_mm)) +
         "\" width=\"" + coordinate(right - kLeft) + "\" height=\"" +
         coordinate(values(c.lower_mm) - values(c.upper_mm)) + "\"/>";
  svg += grid(values, kLeft, right, 5, [](double v, int d) { return with_sign(v, d); });
  svg += grid(ranges, kLeft, right, 2, [](double v, int d) { return fixed(v, d); });
  const auto level = [&](const Axis& axis, double value, const std::string& style, const std::string& name) {
    svg += svg_line(style, kLeft, axis(value), right, axis(value));
    svg += svg_text(right + 5, axis(value) + 4, "start", name, style + "-name");
  };
  if (near_upper) level(values, tolerance, "limit", "+tol");
  if (near_lower) level(values, -tolerance, "limit", "\u2212tol");
  level(values, c.centre_mm, "centre", "mean");
  level(values, c.upper_mm, "control-limit", "UCL");
  level(values, c.lower_mm, "control-limit", "LCL");
  level(ranges, c.range_upper_mm, "control-limit", "UCL");
  level(ranges, c.range_mean_mm, "centre", "MR");
  if (c.baseline < c.used) {
    size_t counted = 0, last = 0;
    for (size_t r = 0; r < n && counted < c.baseline; ++r)
      if (series.runs[r].doubt.empty() && std::isfinite(c.values[r])) last = r, ++counted;
    const double x = to_x(last) + step_x / 2;
    svg += svg_line("baseline-end", x, kTop, x, kFloor) + svg_text(x - 4, kTop + 9, "end", "baseline");
  }
  std::string trace, range_trace, points;
  for (size_t r = 0; r < n; ++r) {
    if (!std::isfinite(c.values[r])) continue;
    const bool counts = series.runs[r].doubt.empty();
    const std::string title = point_title(series, r, c.values[r]);
    if (counts)
      trace += (trace.empty() ? "M" : "L") + coordinate(to_x(r)) + "," + coordinate(values(c.values[r]));
    points += svg_circle(!counts           ? "point left-out"
                         : bad.contains(r) ? "point bad"
                                           : "point",
                         to_x(r), values(c.values[r]), bad.contains(r) ? 4.4 : 3.4, title);
    if (!std::isfinite(c.moving_ranges[r])) continue;
    range_trace += (range_trace.empty() ? "M" : "L") + coordinate(to_x(r)) + "," +
                   coordinate(ranges(c.moving_ranges[r]));
    points += svg_circle(bad_ranges.contains(r) ? "point bad" : "point", to_x(r), ranges(c.moving_ranges[r]),
                         bad_ranges.contains(r) ? 4 : 2.6);
  }
  svg += "<path class=\"trace\" d=\"" + trace + "\"/>";
  if (!range_trace.empty()) svg += "<path class=\"trace\" d=\"" + range_trace + "\"/>";
  svg += points + svg_line("frame", kLeft, kFloor, right, kFloor) + run_numbers(n, kFloor + 17, x0, step_x);
  svg += svg_text(kLeft + (right - kLeft) / 2, kFloor + 31, "middle", "run");
  svg += "<text class=\"side\" transform=\"translate(13," + coordinate((kTop + kMiddle) / 2) +
         ")rotate(-90)\" text-anchor=\"middle\">value (mm)</text>";
  svg += "<text class=\"side\" transform=\"translate(13," + coordinate((kMiddle + kGap + kFloor) / 2) +
         ")rotate(-90)\" text-anchor=\"middle\">range</text>";
  return svg + "</svg>";
}

std::string heat_map_svg(const std::vector<ControlChart>& charts, const Series& series) {
  constexpr double kLeft = 132, kRow = 15, kTop = 24, kWidth = 1120;
  const double columns = static_cast<double>(series.runs.size());
  const double cell = std::min(44.0, (kWidth - kLeft) / columns);
  const double height = kTop + kRow * static_cast<double>(charts.size()) + 4;
  const report::ColourScale colours(series.runs.back().tolerance_mm);
  std::string svg =
      "<svg class=\"chart heat\" role=\"img\" aria-label=\"Deviation of every feature in every run\" "
      "viewBox=\"0 0 " +
      coordinate(kLeft + cell * columns) + " " + coordinate(height) +
      "\" style=\"max-width:" + coordinate(kLeft + cell * columns) + "px\">";
  svg += run_numbers(series.runs.size(), kTop - 8, kLeft + cell / 2, cell);
  for (size_t i = 0; i < charts.size(); ++i) {
    const ControlChart& c = charts[i];
    const double y = kTop + kRow * static_cast<double>(i);
    svg += svg_text(kLeft - 8, y + kRow - 4, "end", escaped(c.name), c.in_control() ? "" : "alarm");
    for (size_t r = 0; r < c.values.size(); ++r) {
      if (!std::isfinite(c.values[r])) continue;
      svg += "<rect x=\"" + coordinate(kLeft + cell * static_cast<double>(r)) + "\" y=\"" + coordinate(y) +
             "\" width=\"" + coordinate(cell - 1) + "\" height=\"" + coordinate(kRow - 1) + "\" fill=\"" +
             report::hex(colours(c.values[r])) + "\"" +
             (series.runs[r].doubt.empty() ? "" : " class=\"faded\"") + "><title>" + escaped(c.name) + ", " +
             point_title(series, r, c.values[r]) + "</title></rect>";
    }
  }
  return svg + "</svg>";
}

}  // namespace gantry::series
