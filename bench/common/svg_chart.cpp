#include "svg_chart.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "gantry/foundation/error.h"
#include "markdown.h"

namespace gantry::bench {
namespace {

constexpr const char* kGrid = "#e3e3e3";
constexpr const char* kPale = "#888";

std::string escaped(const std::string& s) {
  std::string out;
  for (const char c : s) out += c == '<' ? "&lt;" : c == '&' ? "&amp;" : std::string(1, c);
  return out;
}

std::string with_tip(const std::string& shape, const std::string& tip) {
  if (tip.empty()) return shape + "/>\n";
  return shape + "><title>" + escaped(tip) + "</title></" + shape.substr(1, shape.find(' ') - 1) + ">\n";
}

std::string power_of_ten(int exponent) {
  return exponent >= -3 && exponent <= 3 ? text("%g", std::pow(10, exponent)) : text("1e%d", exponent);
}

}  // namespace

Svg::Svg(double width, double height) : width_(width), height_(height) {
  rect(0, 0, width, height, "white");
}

void Svg::line(double x1, double y1, double x2, double y2, const std::string& colour, double width,
               const std::string& dashes) {
  body_ +=
      bench::text("<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" stroke-width=\"%g\"",
                  x1, y1, x2, y2, colour.c_str(), width) +
      (dashes.empty() ? "" : " stroke-dasharray=\"" + dashes + "\"") + "/>\n";
}

void Svg::rect(double x, double y, double width, double height, const std::string& colour,
               const std::string& tip) {
  body_ += with_tip(bench::text("<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"%s\"", x,
                                y, width, height, colour.c_str()),
                    tip);
}

void Svg::circle(double x, double y, double radius, const std::string& colour, const std::string& tip) {
  body_ += with_tip(
      bench::text("<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%g\" fill=\"%s\"", x, y, radius, colour.c_str()), tip);
}

void Svg::text(double x, double y, const std::string& text, const std::string& anchor, double size,
               const std::string& colour) {
  body_ += bench::text("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" font-size=\"%g\" fill=\"%s\">", x, y,
                       anchor.c_str(), size, colour.c_str()) +
           escaped(text) + "</text>\n";
}

void Svg::save(const std::filesystem::path& path) const {
  std::ofstream file(path);
  file << bench::text(
              "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %g %g\" width=\"%g\" height=\"%g\" "
              "font-family=\"Helvetica, Arial, sans-serif\">\n",
              width_, height_, width_, height_)
       << body_ << "</svg>\n";
  file.flush();
  if (!file) throw InputError(path.string() + ": cannot be written");
}

std::string colour_of(size_t series) {
  static const char* colours[] = {"#0072b2", "#d55e00", "#e69f00", "#009e73", "#cc79a7",
                                  "#7f7f7f", "#56b4e9", "#000000", "#8c510a", "#9acd32"};
  return colours[series % std::size(colours)];
}

void save_line_panels(const std::filesystem::path& path, const LinePanels& chart) {
  double low = chart.threshold > 0 ? chart.threshold : 1e9, high = chart.threshold;
  for (const auto& panel : chart.panels)
    for (const auto& line : panel.lines)
      for (const auto& p : line) {
        if (p.median > 0) low = std::min(low, p.median);
        high = std::max(high, p.worst);
      }
  const int first = static_cast<int>(std::floor(std::log10(low)));
  const int last = std::max(first + 1, static_cast<int>(std::ceil(std::log10(high))));
  const double panel_width = 208, plot_height = 240, left = 52, top = 72, gap = 14;
  const double width = left + static_cast<double>(chart.panels.size()) * (panel_width + gap) + 6;
  Svg svg(std::max(width, 620.0), top + plot_height + 66);
  svg.text(10, 20, chart.title, "start", 15);
  double legend = 10;
  for (size_t s = 0; s < chart.series.size(); ++s) {
    svg.circle(legend + 5, 36, 4, colour_of(s));
    svg.text(legend + 14, 40, chart.series[s], "start", 11);
    legend += 26 + 6.1 * static_cast<double>(chart.series[s].size());
  }
  const auto y_of = [&](double value) {
    return top + plot_height * (last - std::log10(std::max(value, std::pow(10, first)))) / (last - first);
  };
  for (size_t k = 0; k < chart.panels.size(); ++k) {
    const double x0 = left + static_cast<double>(k) * (panel_width + gap);
    svg.text(x0 + panel_width / 2, top - 8, chart.panels[k].title, "middle", 13);
    for (int e = first; e <= last; ++e) {
      svg.line(x0, y_of(std::pow(10, e)), x0 + panel_width, y_of(std::pow(10, e)), kGrid);
      if (k == 0) svg.text(x0 - 6, y_of(std::pow(10, e)) + 4, power_of_ten(e), "end", 11, kPale);
    }
    if (chart.threshold > 0)
      svg.line(x0, y_of(chart.threshold), x0 + panel_width, y_of(chart.threshold), "#c00", 1, "5 4");
    const double step = panel_width / static_cast<double>(chart.positions.size());
    for (size_t p = 0; p < chart.positions.size(); ++p) {
      const double x = x0 + (static_cast<double>(p) + 0.5) * step;
      svg.text(x, top + plot_height + 16 + (p % 2 ? 13 : 0), chart.positions[p], "middle", 10, kPale);
    }
    const size_t series = chart.panels[k].lines.size();
    for (size_t s = series; s-- > 0;) {  // the first method on top
      const auto& line = chart.panels[k].lines[s];
      const double shift = (static_cast<double>(s) - static_cast<double>(series - 1) / 2) * 2.6;
      const auto x_of = [&](const LinePanels::Point& p) {
        return x0 + (static_cast<double>(p.position) + 0.5) * step + shift;
      };
      for (size_t i = 0; i < line.size(); ++i) {
        if (i > 0)
          svg.line(x_of(line[i - 1]), y_of(line[i - 1].median), x_of(line[i]), y_of(line[i].median),
                   colour_of(s), 1.6);
        svg.line(x_of(line[i]), y_of(line[i].median), x_of(line[i]), y_of(line[i].worst), colour_of(s), 0.9);
        svg.circle(x_of(line[i]), y_of(line[i].median), 2.8, colour_of(s),
                   chart.series[s] + " " + chart.positions[line[i].position] + ": median " +
                       short_number(line[i].median) + ", worst " + short_number(line[i].worst) + " " +
                       chart.unit);
      }
    }
  }
  svg.text(left, top + plot_height + 54,
           "initial error in degrees and mm; dots: median, strokes: up to the worst" +
               std::string(chart.threshold > 0 ? "; dashed: the limit of success" : ""),
           "start", 11, kPale);
  svg.save(path);
}

void save_bar_grid(const std::filesystem::path& path, const BarGrid& chart) {
  const double bar_width = chart.groups.size() > 1 ? 128 : 460, row_height = 24, left = 168, top = 76;
  double longest = 1e-9;
  for (const auto& row : chart.values)
    for (const auto& bar : row) {
      double sum = 0;
      for (const double v : bar) sum += v;
      longest = std::max(longest, sum);
    }
  Svg svg(left + static_cast<double>(chart.groups.size()) * (bar_width + 58) + 10,
          top + static_cast<double>(chart.rows.size()) * row_height + 14);
  svg.text(10, 20, chart.title, "start", 15);
  double legend = 10;
  for (size_t s = 0; s < chart.segments.size(); ++s) {
    svg.rect(legend, 30, 11, 11, chart.colours[s]);
    svg.text(legend + 16, 40, chart.segments[s], "start", 11);
    legend += 30 + 6.1 * static_cast<double>(chart.segments[s].size());
  }
  for (size_t g = 0; g < chart.groups.size(); ++g)
    svg.text(left + static_cast<double>(g) * (bar_width + 58), top - 10, chart.groups[g], "start", 12);
  for (size_t r = 0; r < chart.rows.size(); ++r) {
    const double y = top + static_cast<double>(r) * row_height;
    svg.text(left - 8, y + 13, chart.rows[r], "end", 12);
    for (size_t g = 0; g < chart.groups.size(); ++g) {
      const double x0 = left + static_cast<double>(g) * (bar_width + 58);
      const auto& bar = chart.values[r][g];
      if (bar.empty()) {
        svg.text(x0, y + 13, "not run", "start", 11, "#bbb");
        continue;
      }
      double sum = 0;
      for (const double v : bar) sum += v;
      const double unit = bar_width / (chart.share ? std::max(sum, 1e-9) : longest);
      double x = x0;
      for (size_t s = 0; s < bar.size(); ++s) {
        if (bar[s] <= 0) continue;
        svg.rect(x, y + 2, bar[s] * unit, row_height - 9, chart.colours[s],
                 chart.segments[s] + ": " + short_number(bar[s]));
        x += bar[s] * unit;
      }
      svg.text(x + 5, y + 13,
               chart.share ? text("%g of %g", bar[0], sum) : short_number(sum) + " " + chart.unit, "start",
               11, kPale);
    }
  }
  svg.save(path);
}

}  // namespace gantry::bench
