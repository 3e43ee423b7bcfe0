#pragma once

#include <cmath>
#include <string>

#include "report/text.h"

namespace gantry::series {

/// Pieces of inline SVG; words are HTML already.
inline std::string svg_text(double x, double y, const std::string& anchor, const std::string& words,
                            const std::string& style = "") {
  return "<text" + (style.empty() ? "" : " class=\"" + style + "\"") + " x=\"" + report::coordinate(x) +
         "\" y=\"" + report::coordinate(y) + "\" text-anchor=\"" + anchor + "\">" + words + "</text>";
}

inline std::string svg_line(const std::string& style, double x1, double y1, double x2, double y2) {
  return "<path class=\"" + style + "\" d=\"M" + report::coordinate(x1) + "," + report::coordinate(y1) + "L" +
         report::coordinate(x2) + "," + report::coordinate(y2) + "\"/>";
}

inline std::string svg_circle(const std::string& style, double x, double y, double radius,
                              const std::string& title = "") {
  return "<circle class=\"" + style + "\" cx=\"" + report::coordinate(x) + "\" cy=\"" +
         report::coordinate(y) + "\" r=\"" + report::coordinate(radius) + "\">" +
         (title.empty() ? "" : "<title>" + title + "</title>") + "</circle>";
}

/// Round steps of 1, 2 or 5 times a power of ten, about `wanted` of them over `span`.
inline double round_step(double span, int wanted) {
  const double raw = span / wanted, power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0})
    if (raw <= factor * power * (1 + 1e-9)) return factor * power;
  return 10 * power;
}

inline int decimals_of(double step) {
  return std::max(0, static_cast<int>(std::ceil(-std::log10(step) - 1e-9)));
}

}  // namespace gantry::series
