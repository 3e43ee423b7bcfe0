#include "sweep_chart.h"

#include <algorithm>
#include <cmath>

#include "markdown.h"
#include "svg_chart.h"

namespace gantry::bench {
namespace {

constexpr double kPanelWidth = 230, kPlotHeight = 330, kLeft = 60, kTop = 92, kGap = 16;
constexpr const char* kGrid = "#e3e3e3";
constexpr const char* kPale = "#777";

/// 1, 2 or 5 times a power of ten, for some eight lines over the range.
double grid_step(double range) {
  const double rough = range / 8, power = std::pow(10, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0})
    if (factor * power >= rough) return factor * power;
  return 10 * power;
}

}  // namespace

void save_sweep_chart(const std::filesystem::path& path, const SweepChart& chart) {
  double low = 0, high = 0;
  for (const auto& panel : chart.panels)
    for (const auto& line : panel.lines)
      for (const auto& p : line) {
        low = std::min(low, p.mean - p.spread);
        high = std::max(high, p.mean + p.spread);
      }
  const double step = grid_step(std::max(high - low, 1e-6));
  low = step * std::floor(low / step);
  high = step * std::ceil(high / step);
  const auto y_of = [&](double value) { return kTop + kPlotHeight * (high - value) / (high - low); };

  const double width = kLeft + static_cast<double>(chart.panels.size()) * (kPanelWidth + kGap) + 6;
  Svg svg(width, kTop + kPlotHeight + 56);
  svg.text(10, 20, chart.title, "start", 15);
  double legend = 10, legend_y = 38;
  for (size_t s = 0; s < chart.series.size(); ++s) {
    const double length = 28 + 6.3 * static_cast<double>(chart.series[s].size());
    if (legend + length > width) {
      legend = 10;
      legend_y += 17;
    }
    svg.circle(legend + 5, legend_y, 4, colour_of(s));
    svg.text(legend + 14, legend_y + 4, chart.series[s], "start", 11);
    legend += length;
  }
  const double column = kPanelWidth / static_cast<double>(chart.positions.size());
  for (size_t k = 0; k < chart.panels.size(); ++k) {
    const double x0 = kLeft + static_cast<double>(k) * (kPanelWidth + kGap);
    svg.text(x0 + kPanelWidth / 2, kTop - 8, chart.panels[k].title, "middle", 13);
    for (double y = low; y < high + step / 2; y += step) {
      const bool zero = std::abs(y) < step / 2;
      svg.line(x0, y_of(y), x0 + kPanelWidth, y_of(y), zero ? "#555" : kGrid);
      if (k == 0) svg.text(x0 - 6, y_of(y) + 4, zero ? "0" : text("%+g", y), "end", 11, kPale);
    }
    const size_t series = chart.panels[k].lines.size();
    for (size_t p = 0; p < chart.positions.size(); ++p)
      svg.text(x0 + (static_cast<double>(p) + 0.5) * column, kTop + kPlotHeight + 16, chart.positions[p],
               "middle", 11, kPale);
    for (size_t s = series; s-- > 0;) {  // the first on top
      const auto& line = chart.panels[k].lines[s];
      const double shift = (static_cast<double>(s) - static_cast<double>(series - 1) / 2) * 2.4;
      const auto x_of = [&](size_t p) { return x0 + (static_cast<double>(p) + 0.5) * column + shift; };
      for (size_t p = 0; p < line.size(); ++p) {
        const auto& [mean, spread] = line[p];
        if (p > 0) svg.line(x_of(p - 1), y_of(line[p - 1].mean), x_of(p), y_of(mean), colour_of(s), 1.4);
        svg.line(x_of(p), y_of(mean - spread), x_of(p), y_of(mean + spread), colour_of(s), 1);
        svg.circle(x_of(p), y_of(mean), 2.6, colour_of(s),
                   chart.series[s] + ", " + chart.positions[p] + text(": %+.4f ± %.4f", mean, spread));
      }
    }
  }
  svg.text(kLeft, kTop + kPlotHeight + 40, chart.x_title + "; " + chart.y_title, "start", 11, kPale);
  svg.save(path);
}

}  // namespace gantry::bench
