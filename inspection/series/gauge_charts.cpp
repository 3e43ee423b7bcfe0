#include <algorithm>

#include "series/charts.h"
#include "series/svg.h"

namespace gantry::series {

using report::coordinate;
using report::escaped;
using report::fixed;
using report::with_sign;

std::string gauge_points_svg(const GaugeResult& result, const GaugeReport& report) {
  constexpr double kWidth = 560, kLeft = 62, kRight = 14, kTop = 14, kFloor = 232;
  const size_t parts = report.parts.size(), appraisers = report.appraisers.size(), trials = report.trials;
  const auto [least, greatest] = std::minmax_element(result.values.begin(), result.values.end());
  const double margin = 0.08 * std::max(*greatest - *least, 1e-6);
  const double low = *least - margin, high = *greatest + margin;
  const auto to_y = [&](double v) { return kFloor - (kFloor - kTop) * (v - low) / (high - low); };
  const double slot = (kWidth - kLeft - kRight) / static_cast<double>(parts);
  const double lane = 0.8 * slot / static_cast<double>(appraisers);
  std::string svg = "<svg class=\"chart control\" role=\"img\" aria-label=\"Measurements of " +
                    escaped(result.name) + "\" viewBox=\"0 0 560 270\">";
  const double step = round_step(high - low, 5);
  for (double k = std::ceil(low / step); k * step <= high; ++k) {
    svg += svg_line("grid", kLeft, to_y(k * step), kWidth - kRight, to_y(k * step));
    svg += svg_text(kLeft - 7, to_y(k * step) + 4, "end", with_sign(k * step, decimals_of(step)));
  }
  for (size_t p = 0; p < parts; ++p) {
    const double left = kLeft + slot * static_cast<double>(p);
    if (p > 0) svg += svg_line("grid", left, kTop, left, kFloor);
    svg += svg_text(left + slot / 2, kFloor + 17, "middle", escaped(report.parts[p]));
    for (size_t a = 0; a < appraisers; ++a) {
      const double x = left + 0.1 * slot + lane * (static_cast<double>(a) + 0.5);
      const std::string style = "appraiser-" + std::to_string(a % 6);
      double mean = 0;
      for (size_t t = 0; t < trials; ++t) {
        const double value = result.values[(p * appraisers + a) * trials + t];
        mean += value / static_cast<double>(trials);
        const double shift =
            lane * 0.5 * ((static_cast<double>(t) + 0.5) / static_cast<double>(trials) - 0.5);
        svg += svg_circle("point " + style, x + shift, to_y(value), 3.2,
                          escaped(report.appraisers[a]) + " " + with_sign(value, 4) + " mm");
      }
      svg += svg_line("cell-mean " + style, x - 0.36 * lane, to_y(mean), x + 0.36 * lane, to_y(mean));
    }
  }
  svg += svg_line("frame", kLeft, kFloor, kWidth - kRight, kFloor);
  svg += svg_text(kLeft + (kWidth - kLeft - kRight) / 2, kFloor + 33, "middle", "part");
  return svg + "</svg>";
}

std::string gauge_bars_svg(const std::vector<const GaugeResult*>& results) {
  constexpr double kWidth = 1120, kLeft = 150, kRight = 70, kRow = 22, kTop = 8;
  double reach = 35;
  for (const GaugeResult* r : results) reach = std::max(reach, 1.05 * r->percent_tolerance.value);
  reach = std::min(reach, 130.0);
  const double floor_y = kTop + kRow * static_cast<double>(results.size());
  const auto to_x = [&](double percent) {
    return kLeft + (kWidth - kLeft - kRight) * std::clamp(percent / reach, 0.0, 1.0);
  };
  std::string svg =
      "<svg class=\"chart bars\" role=\"img\" aria-label=\"GRR in percent of the tolerance\" "
      "viewBox=\"0 0 1120 " +
      coordinate(floor_y + 40) + "\">";
  for (const double limit : {10.0, 30.0})
    svg += svg_line("control-limit", to_x(limit), kTop - 4, to_x(limit), floor_y) +
           svg_text(to_x(limit), floor_y + 17, "middle", fixed(limit, 0) + "\u202f%", "strong");
  for (size_t i = 0; i < results.size(); ++i) {
    const GaugeResult& r = *results[i];
    const double y = kTop + kRow * static_cast<double>(i), percent = r.percent_tolerance.value;
    const std::string style = percent < 10 ? "good" : percent <= 30 ? "fair" : "poor";
    svg += svg_text(kLeft - 8, y + 14, "end", escaped(r.name));
    svg += "<rect class=\"bar-" + style + "\" x=\"" + coordinate(kLeft) + "\" y=\"" + coordinate(y + 3) +
           "\" width=\"" + coordinate(to_x(percent) - kLeft) + "\" height=\"14\" rx=\"2\"/>";
    svg += svg_line("whisker", to_x(r.percent_tolerance.low), y + 10, to_x(r.percent_tolerance.high), y + 10);
    svg += svg_text(kWidth - kRight + 8, y + 14, "start", fixed(percent, 1) + "\u202f%", "strong");
  }
  svg += svg_line("frame", kLeft, floor_y, kWidth - kRight, floor_y);
  svg += svg_text((kLeft + kWidth - kRight) / 2, floor_y + 33, "middle",
                  "6 GRR in percent of the width of the tolerance; thin line: its 95\u202f% interval");
  return svg + "</svg>";
}

}  // namespace gantry::series
