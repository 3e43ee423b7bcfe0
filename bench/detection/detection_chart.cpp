#include "detection_chart.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "markdown.h"
#include "svg_chart.h"

namespace gantry::bench {
namespace {

constexpr double kWidth = 760, kHeight = 400, kLeft = 60, kRight = 130, kTop = 44, kBottom = 46;

}  // namespace

void save_detection_chart(const std::filesystem::path& path, const DetectionChart& chart) {
  double low = 1e9, high = 0;
  for (const auto& s : chart.series)
    for (const Trial& t : s.trials) {
      low = std::min(low, t.depth_mm);
      high = std::max(high, t.depth_mm);
    }
  const double from = std::log(low / 1.1), to = std::log(high * 1.1);
  const auto x_of = [&](double depth) {
    return kLeft + (std::log(depth) - from) / (to - from) * (kWidth - kLeft - kRight);
  };
  const auto y_of = [&](double p) { return kHeight - kBottom - p * (kHeight - kTop - kBottom); };
  Svg svg(kWidth, kHeight);
  svg.rect(0, 0, kWidth, kHeight, "#fff");
  svg.text(kLeft, 24, chart.title, "start", 15, "#111");
  for (const double p : {0.0, 0.25, 0.5, 0.75, 0.9, 1.0}) {
    svg.line(kLeft, y_of(p), kWidth - kRight, y_of(p), p == 0.9 ? "#aaa" : "#e2e2e2", 1,
             p == 0.9 ? "4 3" : "");
    svg.text(kLeft - 8, y_of(p) + 4, text("%.0f %%", 100 * p), "end", 11);
  }
  for (const double depth : {0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0}) {
    if (depth < low / 1.1 || depth > high * 1.1) continue;
    svg.line(x_of(depth), y_of(0), x_of(depth), y_of(0) + 5, "#333");
    svg.text(x_of(depth), y_of(0) + 18, text("%g", depth), "middle", 11);
  }
  svg.text((kLeft + kWidth - kRight) / 2, kHeight - 8, "depth of the dent, mm", "middle");
  svg.line(x_of(chart.tolerance_mm), y_of(0), x_of(chart.tolerance_mm), y_of(1), "#888", 1.5, "6 4");
  svg.text(x_of(chart.tolerance_mm), y_of(1) - 5, "tolerance", "middle", 11);
  for (size_t k = 0; k < chart.series.size(); ++k) {
    const auto& s = chart.series[k];
    const std::string colour = colour_of(k);
    svg.line(kWidth - kRight + 14, kTop + 8 + 20 * static_cast<double>(k), kWidth - kRight + 36,
             kTop + 8 + 20 * static_cast<double>(k), colour, 2.5);
    svg.text(kWidth - kRight + 42, kTop + 12 + 20 * static_cast<double>(k), s.name);
    std::map<double, std::pair<double, double>> shares;  // by depth: found, tried
    for (const Trial& t : s.trials) {
      shares[t.depth_mm].first += t.found;
      ++shares[t.depth_mm].second;
    }
    for (const auto& [depth, share] : shares)
      svg.circle(x_of(depth), y_of(share.first / share.second), 3.2, colour,
                 text("%s, %g mm deep: %.0f of %.0f", s.name.c_str(), depth, share.first, share.second));
    if (!s.curve) continue;
    constexpr int kSteps = 120;
    for (int i = 0; i < kSteps; ++i) {
      const double a = std::exp(from + (to - from) * i / kSteps),
                   b = std::exp(from + (to - from) * (i + 1) / kSteps);
      svg.line(x_of(a), y_of(s.curve->probability(a)), x_of(b), y_of(s.curve->probability(b)), colour, 2);
    }
  }
  svg.save(path);
}

}  // namespace gantry::bench
