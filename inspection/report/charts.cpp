#include "report/charts.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "report/text.h"

namespace gantry::report {
namespace {

constexpr size_t kBins = 81;

/// Round steps of 1, 2 or 5 times a power of ten, about `wanted` of them over `span`.
double round_step(double span, int wanted) {
  const double raw = span / wanted, power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0})
    if (raw <= factor * power) return factor * power;
  return 10 * power;
}

int decimals_of(double step) {
  return std::max(0, static_cast<int>(std::ceil(-std::log10(step) - 1e-9)));
}

std::string text(double x, double y, const std::string& anchor, const std::string& words,
                 const std::string& style = "") {
  return "<text" + (style.empty() ? "" : " class=\"" + style + "\"") + " x=\"" + coordinate(x) + "\" y=\"" +
         coordinate(y) + "\" text-anchor=\"" + anchor + "\">" + words + "</text>";
}

std::string line(const std::string& style, double x1, double y1, double x2, double y2) {
  return "<path class=\"" + style + "\" d=\"M" + coordinate(x1) + "," + coordinate(y1) + "L" +
         coordinate(x2) + "," + coordinate(y2) + "\"/>";
}

/// Short counts for an axis: "20k", "1.5M".
std::string count_text(double count) {
  if (count >= 1e6) return fixed(count / 1e6, std::fmod(count, 1e6) > 0 ? 1 : 0) + "M";
  if (count >= 1e4) return fixed(count / 1e3, std::fmod(count, 1e3) > 0 ? 1 : 0) + "k";
  return fixed(count, 0);
}

/// The judged deviations, counted over the range drawn.
struct Histogram {
  double reach_mm;  // drawn from -reach to +reach
  std::vector<size_t> counts = std::vector<size_t>(kBins, 0);
  size_t beyond = 0;

  double bin_mm() const { return 2 * reach_mm / kBins; }
};

Histogram histogram(const std::vector<float>& values, double reach_mm) {
  Histogram h{reach_mm};
  for (const float v : values) {
    if (std::abs(v) >= reach_mm) {
      ++h.beyond;
    } else {
      ++h.counts[std::min(kBins - 1, static_cast<size_t>((v + reach_mm) / h.bin_mm()))];
    }
  }
  return h;
}

}  // namespace

std::string histogram_svg(const Distribution& distribution, const ColourScale& colours, CountAxis axis) {
  constexpr double kWidth = 560, kHeight = 318, kLeft = 50, kRight = 14, kTop = 30, kBottom = 66;
  constexpr double kPlotWidth = kWidth - kLeft - kRight, kPlotHeight = kHeight - kTop - kBottom;
  const bool logarithmic = axis == CountAxis::kLogarithmic;
  const double floor_y = kTop + kPlotHeight, tolerance = colours.tolerance_mm();
  const std::vector<float>& values = distribution.sorted_mm;
  double reach = 1.5 * tolerance;
  if (logarithmic && !values.empty())
    reach =
        std::clamp(1.08 * std::max(std::abs(values.front()), std::abs(values.back())), reach, 5 * tolerance);
  const Histogram h = histogram(values, reach);

  const auto exists = [&](const Gaussian& g) {
    return values.size() > 1 && std::isfinite(g.mean_mm) && std::isfinite(g.sigma_mm) && g.sigma_mm > 0;
  };
  const auto expected = [&](const Gaussian& g, double mm) {  // points per bin
    const double z = (mm - g.mean_mm) / g.sigma_mm;
    return static_cast<double>(values.size()) * h.bin_mm() * std::exp(-0.5 * z * z) /
           (g.sigma_mm * std::sqrt(2 * std::numbers::pi));
  };
  auto top = static_cast<double>(std::max<size_t>(1, *std::max_element(h.counts.begin(), h.counts.end())));
  // The logarithmic axis ends at a power of ten.
  top = logarithmic ? std::pow(10.0, std::ceil(std::log10(top) + 0.05)) : 1.12 * top;
  const auto to_x = [&](double mm) { return kLeft + kPlotWidth * (mm + reach) / (2 * reach); };
  const auto to_y = [&](double count) {
    // A single point stands clear of the logarithmic axis, which starts at one half.
    const double share =
        logarithmic ? std::log10(std::max(count, 0.5) / 0.5) / std::log10(top / 0.5) : count / top;
    return floor_y - kPlotHeight * std::clamp(share, 0.0, 1.0);
  };

  std::string svg = "<svg class=\"chart\" role=\"img\" aria-label=\"Histogram of the deviations, " +
                    std::string(logarithmic ? "logarithmic" : "linear") +
                    " counts\" viewBox=\"0 0 560 318\">";
  const double count_step = std::max(1.0, round_step(top, 4));
  for (double count = logarithmic ? 1 : 0; count <= 1.01 * top;
       count = logarithmic ? 10 * count : count + count_step) {
    svg += line("grid", kLeft, to_y(count), kWidth - kRight, to_y(count));
    svg += text(kLeft - 7, to_y(count) + 4, "end", count_text(count));
  }
  for (size_t i = 0; i < h.counts.size(); ++i) {
    if (h.counts[i] == 0) continue;
    const double from = -reach + static_cast<double>(i) * h.bin_mm();
    const double x = to_x(from), y = to_y(static_cast<double>(h.counts[i]));
    svg += "<rect x=\"" + coordinate(x) + "\" y=\"" + coordinate(y) + "\" width=\"" +
           coordinate(to_x(from + h.bin_mm()) - x - 0.6) + "\" height=\"" + coordinate(floor_y - y) +
           "\" fill=\"" + hex(colours(from + 0.5 * h.bin_mm())) + "\"/>";
  }
  for (const double limit : {-tolerance, tolerance}) {
    svg += line("limit", to_x(limit), kTop - 6, to_x(limit), floor_y);
    svg += text(to_x(limit), kTop - 12, limit < 0 ? "end" : "start", with_sign(limit, 2) + " tolerance",
                "strong");
  }
  const auto draw = [&](const Gaussian& g, const std::string& style) {
    if (!exists(g)) return;
    std::string path;
    bool drawing = false;
    for (int i = 0; i <= 400; ++i) {
      const double mm = reach * (i - 200) / 200, count = expected(g, mm);
      if (count > top || (logarithmic && count < 0.5)) {
        drawing = false;
        continue;
      }
      path += (drawing ? "L" : "M") + coordinate(to_x(mm)) + "," + coordinate(to_y(count));
      drawing = true;
    }
    if (!path.empty()) svg += "<path class=\"" + style + "\" d=\"" + path + "\"/>";
  };
  draw(distribution.all, "gauss all");
  draw(distribution.bulk, "gauss");
  svg += line("frame", kLeft, floor_y, kWidth - kRight, floor_y);
  const double step = round_step(2 * reach, 8);
  for (double k = std::ceil(-0.97 * reach / step); k * step <= 0.97 * reach; ++k) {
    svg += line("frame", to_x(k * step), floor_y, to_x(k * step), floor_y + 5);
    svg += text(to_x(k * step), floor_y + 19, "middle", with_sign(k * step, decimals_of(step)));
  }
  svg += text(kLeft + kPlotWidth / 2, floor_y + 38, "middle", "deviation (mm)");
  if (h.beyond > 0)
    svg += text(kWidth - kRight, floor_y + 58, "end",
                grouped(h.beyond) + (h.beyond == 1 ? " point" : " points") + " beyond this range");
  if (values.empty())
    svg += text(kLeft + kPlotWidth / 2, kTop + kPlotHeight / 2, "middle", "no judged points");
  return svg + "</svg>";
}

std::string magnitudes_svg(const Distribution& distribution, const ColourScale& colours) {
  constexpr double kWidth = 560, kHeight = 318, kLeft = 50, kRight = 14, kTop = 30, kBottom = 66;
  constexpr double kPlotWidth = kWidth - kLeft - kRight, kPlotHeight = kHeight - kTop - kBottom;
  constexpr size_t kBars = 60;
  const double tolerance = colours.tolerance_mm(), floor_y = kTop + kPlotHeight;
  // Wide enough for the good surface, whose shape the fit is about.
  const double usual = distribution.magnitudes_mm.empty() ? 0.0 : 6 * distribution.magnitude_p50_mm;
  const double reach = std::clamp(usual, 0.2 * tolerance, 1.5 * tolerance), bin = reach / kBars;
  std::vector<size_t> counts(kBars, 0);
  size_t beyond = 0;
  for (const float v : distribution.magnitudes_mm) {
    if (v >= reach) {
      ++beyond;
    } else {
      ++counts[std::min(kBars - 1, static_cast<size_t>(v / bin))];
    }
  }
  const double top =
      1.12 * static_cast<double>(std::max<size_t>(1, *std::max_element(counts.begin(), counts.end())));
  const auto to_x = [&](double mm) { return kLeft + kPlotWidth * mm / reach; };
  const auto to_y = [&](double count) { return floor_y - kPlotHeight * std::clamp(count / top, 0.0, 1.0); };
  std::string svg =
      "<svg class=\"chart\" role=\"img\" aria-label=\"Histogram of the magnitudes of the deviations\" "
      "viewBox=\"0 0 560 318\">";
  const double count_step = std::max(1.0, round_step(top, 4));
  for (double count = 0; count <= 1.01 * top; count += count_step) {
    svg += line("grid", kLeft, to_y(count), kWidth - kRight, to_y(count));
    svg += text(kLeft - 7, to_y(count) + 4, "end", count_text(count));
  }
  for (size_t i = 0; i < kBars; ++i) {
    if (counts[i] == 0) continue;
    const double x = to_x(static_cast<double>(i) * bin), y = to_y(static_cast<double>(counts[i]));
    svg += "<rect class=\"magnitude\" x=\"" + coordinate(x) + "\" y=\"" + coordinate(y) + "\" width=\"" +
           coordinate(to_x(bin) - kLeft - 0.6) + "\" height=\"" + coordinate(floor_y - y) + "\"/>";
  }
  if (tolerance < reach) {
    svg += line("limit", to_x(tolerance), kTop - 6, to_x(tolerance), floor_y);
    svg += text(to_x(tolerance), kTop - 12, "middle", fixed(tolerance, 2) + " tolerance", "strong");
  } else {
    svg += text(kWidth - kRight, kTop - 12, "end", "tolerance " + fixed(tolerance, 2) + " \u2192", "strong");
  }
  if (distribution.weibull) {
    std::string path;
    const double points = static_cast<double>(distribution.magnitudes_mm.size()) * bin;
    bool drawing = false;
    for (int i = 1; i <= 300; ++i) {
      const double mm = reach * i / 300, count = points * distribution.weibull->density(mm);
      if (count <= top) path += (drawing ? "L" : "M") + coordinate(to_x(mm)) + "," + coordinate(to_y(count));
      drawing = count <= top;
    }
    svg += "<path class=\"gauss\" d=\"" + path + "\"/>";
  }
  svg += line("frame", kLeft, floor_y, kWidth - kRight, floor_y);
  const double step = round_step(reach, 6);
  for (double k = 0; k * step <= 0.97 * reach; ++k) {
    svg += line("frame", to_x(k * step), floor_y, to_x(k * step), floor_y + 5);
    svg += text(to_x(k * step), floor_y + 19, "middle", fixed(k * step, decimals_of(step)));
  }
  svg += text(kLeft + kPlotWidth / 2, floor_y + 38, "middle", "magnitude of the deviation (mm)");
  if (beyond > 0)
    svg += text(kWidth - kRight, floor_y + 58, "end",
                grouped(beyond) + (beyond == 1 ? " point" : " points") + " beyond this range");
  if (distribution.magnitudes_mm.empty())
    svg += text(kLeft + kPlotWidth / 2, kTop + kPlotHeight / 2, "middle", "no judged points");
  return svg + "</svg>";
}

std::string legend_svg(const ColourScale& colours) {
  constexpr double kLeft = 40, kBar = 520, kTop = 22, kThick = 18;
  const double limit = colours.limit_mm(), tolerance = colours.tolerance_mm();
  const auto to_x = [&](double mm) { return kLeft + kBar * (mm + limit) / (2 * limit); };
  std::string svg =
      "<svg class=\"legend\" role=\"img\" aria-label=\"Colour scale of the deviation in mm\" viewBox=\"0 0 "
      "600 66\">"
      "<defs><linearGradient id=\"scale\">";
  for (int i = 0; i <= 40; ++i)
    svg += "<stop offset=\"" + coordinate(i / 40.0) + "\" stop-color=\"" +
           hex(colours(limit * (i - 20) / 20.0)) + "\"/>";
  svg += "</linearGradient></defs><rect x=\"" + coordinate(kLeft) + "\" y=\"" + coordinate(kTop) +
         "\" width=\"" + coordinate(kBar) + "\" height=\"" + coordinate(kThick) +
         "\" rx=\"3\" fill=\"url(#scale)\"/>";
  const int decimals = decimals_of(tolerance / 2) + (tolerance < 1 ? 0 : 1);
  for (int k = -4; k <= 4; ++k) {
    const double mm = k * tolerance / 2, x = to_x(mm);
    const bool at_limit = std::abs(k) == 2;
    svg += line(at_limit ? "limit" : "frame", x, at_limit ? kTop - 5 : kTop + kThick, x, kTop + kThick + 6);
    const std::string beyond = k == -4 ? "\u2264 " : k == 4 ? "\u2265 " : "";
    svg += text(x, kTop + kThick + 21, "middle", beyond + with_sign(mm, decimals), at_limit ? "strong" : "");
  }
  svg += text(to_x(-tolerance), 12, "middle", "\u2212 tolerance", "strong");
  svg += text(to_x(tolerance), 12, "middle", "+ tolerance", "strong");
  svg += text(to_x(0), 12, "middle", "deviation (mm)");
  svg += text(kLeft, 12, "start", "missing") + text(kLeft + kBar, 12, "end", "excess");
  return svg + "</svg>";
}

}  // namespace gantry::report
