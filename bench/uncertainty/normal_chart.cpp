#include "normal_chart.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "markdown.h"
#include "svg_chart.h"

namespace gantry::bench {
namespace {

constexpr double kRange = 4;  ///< From minus to plus so many standard uncertainties.
constexpr int kBins = 64;
constexpr double kWidth = 760, kHeight = 380, kLeft = 60, kBottom = 320, kTop = 60;
constexpr double kHighest = 0.55;  ///< Density at the top.

double x_of(double z) {
  return kLeft + (z + kRange) / (2 * kRange) * (kWidth - kLeft - 20);
}
double y_of(double density) {
  return kBottom - std::min(density, kHighest) / kHighest * (kBottom - kTop);
}

}  // namespace

void save_normal_chart(const std::filesystem::path& path, const NormalChart& chart) {
  Svg svg(kWidth, kHeight);
  svg.text(kLeft, 24, chart.title, "start", 15);
  for (int z = -4; z <= 4; ++z) {
    svg.line(x_of(z), kBottom, x_of(z), kTop, "#ddd");
    svg.text(x_of(z), kBottom + 16, std::to_string(z), "middle");
  }
  for (const double limit : {-1.96, 1.96})
    svg.line(x_of(limit), kBottom, x_of(limit), kTop, "#999", 1, "4 3");
  svg.text(x_of(1.96), kTop - 6, "95 % lie between these", "middle", 11, "#777");
  const double bin = 2 * kRange / kBins;
  for (size_t s = 0; s < chart.series.size(); ++s) {
    std::vector<double> density(kBins, 0);
    for (const double z : chart.series[s].values) {
      const int k = static_cast<int>(std::floor((z + kRange) / bin));
      if (k >= 0 && k < kBins)
        density[static_cast<size_t>(k)] += 1 / (bin * static_cast<double>(chart.series[s].values.size()));
    }
    for (int k = 0; k + 1 < kBins; ++k)
      svg.line(x_of(-kRange + (k + 0.5) * bin), y_of(density[static_cast<size_t>(k)]),
               x_of(-kRange + (k + 1.5) * bin), y_of(density[static_cast<size_t>(k) + 1]), colour_of(s), 2);
    svg.line(kLeft + 10, kTop + 14 + 18.0 * static_cast<double>(s), kLeft + 34,
             kTop + 14 + 18.0 * static_cast<double>(s), colour_of(s), 2);
    svg.text(kLeft + 40, kTop + 18 + 18.0 * static_cast<double>(s), chart.series[s].name, "start", 11);
  }
  for (int k = 0; k < 160; ++k) {
    const auto normal = [](double z) { return std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi); };
    const double a = -kRange + k * 0.05, b = a + 0.05;
    svg.line(x_of(a), y_of(normal(a)), x_of(b), y_of(normal(b)), "#333", 1, "2 2");
  }
  svg.text(kWidth - 20, kHeight - 12, "dotted: standard normal distribution", "end", 11, "#777");
  svg.save(path);
}

}  // namespace gantry::bench
