#include "report/section_chart.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "report/text.h"

namespace gantry::report {
namespace {

constexpr float kWidth = 560, kLeast = 150, kMost = 460, kMargin = 34, kFoot = 40;
constexpr int kShades = 32;     // groups of points that are drawn in one colour
constexpr float kCell = 1.6f;   // pixels: of the points of a cell the one that deviates most is drawn
constexpr float kStalk = 2.5f;  // pixels: a shorter way from nominal to measured is not drawn as a line

std::string point(const Eigen::Vector2f& p) {
  return coordinate(p.x()) + "," + coordinate(p.y());
}

/// From the plane (mm) to the picture (pixels).
struct Layout {
  Eigen::AlignedBox2f box;
  float scale = 1, height = 0;

  Layout(const Section& section, float reach_mm) {
    for (const SectionLine& line : section.outline)
      for (const auto& p : line.points) box.extend(p);
    box.min().array() -= reach_mm;
    box.max().array() += reach_mm;
    const Eigen::Vector2f size = box.sizes().cwiseMax(1e-3f);
    scale = std::min((kWidth - 2 * kMargin) / size.x(), (kMost - 2 * kMargin) / size.y());
    height = std::max(kLeast, scale * size.y() + 2 * kMargin);
  }
  Eigen::Vector2f operator()(const Eigen::Vector2f& p) const {
    const Eigen::Vector2f from_middle = scale * (p - box.center());
    return {0.5f * kWidth + from_middle.x(), 0.5f * height - from_middle.y()};
  }
};

/// Points of one shade of the colour scale.
struct Marks {
  std::string stalks, dots;
};

/// The measured points, by shade.
std::vector<Marks> marks(const Section& section, const Layout& layout, const ColourScale& colours,
                         float times) {
  std::map<std::pair<int, int>, const Section::Measured*> strongest;
  const auto end_of = [&](const Section::Measured& m) {
    return layout(m.on_cad ? Eigen::Vector2f(m.nominal + times * m.deviation_mm * m.outwards) : m.nominal);
  };
  for (const auto& m : section.measured) {
    const Eigen::Vector2f cell = end_of(m) / kCell;
    auto& kept = strongest[{static_cast<int>(std::floor(cell.y())), static_cast<int>(std::floor(cell.x()))}];
    if (!kept || std::abs(m.deviation_mm) > std::abs(kept->deviation_mm)) kept = &m;
  }
  std::vector<Marks> by_shade(kShades);
  for (const auto& [cell, m] : strongest) {
    const double at = 0.5 + 0.5 * m->deviation_mm / colours.limit_mm();
    Marks& shade = by_shade[static_cast<size_t>(std::clamp(at, 0.0, 1.0) * (kShades - 1) + 0.5)];
    const Eigen::Vector2f from = layout(m->nominal), to = end_of(*m);
    if ((to - from).norm() > kStalk) shade.stalks += "M" + point(from) + "L" + point(to);
    shade.dots += "M" + point(to) + "h0";
  }
  return by_shade;
}

double round_length(double most) {
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  for (const double factor : {5.0, 2.0})
    if (factor * power <= most) return factor * power;
  return power;
}

}  // namespace

double exaggeration(const Section& section, double tolerance_mm) {
  Eigen::AlignedBox2f box;
  for (const SectionLine& line : section.outline)
    for (const auto& p : line.points) box.extend(p);
  std::vector<float> magnitudes;
  for (const auto& m : section.measured)
    if (m.on_cad) magnitudes.push_back(std::abs(m.deviation_mm));
  double usual = 0;  // what all but a few stay within
  if (!magnitudes.empty()) {
    const auto at = magnitudes.begin() + static_cast<std::ptrdiff_t>(magnitudes.size() * 98 / 100);
    std::nth_element(magnitudes.begin(), at, magnitudes.end());
    usual = *at;
  }
  const double size = box.isEmpty() ? 1.0 : std::max(box.sizes().maxCoeff(), 1e-3f);
  const double most = std::min(0.09 * size / std::max(usual, 1e-9), 0.03 * size / tolerance_mm);
  return std::max(1.0, round_length(most));
}

std::string section_name(const Section& section) {
  const std::string axis(1, "xyz"[section.axis]);
  return std::string(1, section.letter) + ": " + axis + " = " + fixed(section.offset_mm, 2) +
         "\u202fmm, seen from " + (section.from_positive_side() ? "+" : "\u2212") + axis;
}

std::string section_svg(const Section& section, const ColourScale& colours) {
  const double times = exaggeration(section, colours.tolerance_mm());
  const auto band_mm = static_cast<float>(times * colours.tolerance_mm());
  const Layout layout(section, band_mm);
  const float height = layout.height + kFoot;
  const std::string id = std::string("section-") + section.letter;
  std::string contour;
  for (const SectionLine& line : section.outline) {
    for (size_t i = 0; i < line.points.size(); ++i)
      contour += (i ? "L" : "M") + point(layout(line.points[i]));
    if (line.closed) contour += "Z";
  }
  std::string svg = "<svg class=\"section\" id=\"" + id + "\" role=\"img\" aria-label=\"Section " +
                    escaped(section_name(section)) + "\" viewBox=\"0 0 " + coordinate(kWidth) + " " +
                    coordinate(height) + "\"><path class=\"band\" stroke-width=\"" +
                    coordinate(2 * band_mm * layout.scale) + "\" d=\"" + contour + "\"/>";
  svg += "<path class=\"material\" d=\"" + contour + "\"/>";
  const std::vector<Marks> all = marks(section, layout, colours, static_cast<float>(times));
  for (size_t i = 0; i < all.size(); ++i) {
    if (all[i].dots.empty()) continue;
    const std::string colour =
        hex(colours(colours.limit_mm() * (2.0 * static_cast<double>(i) / (kShades - 1) - 1)));
    svg += "<g stroke=\"" + colour + "\">";
    if (!all[i].stalks.empty()) svg += "<path class=\"stalk\" d=\"" + all[i].stalks + "\"/>";
    svg += "<path class=\"measured\" d=\"" + all[i].dots + "\"/></g>";
  }
  svg += "<path class=\"nominal\" d=\"" + contour + "\"/>";

  const double length = round_length(0.2 * kWidth / layout.scale), bar = length * layout.scale;
  const std::string base = coordinate(height - 14);
  svg += "<path class=\"bar\" d=\"M" + coordinate(kMargin) + "," + coordinate(height - 20) + "v6h" +
         coordinate(bar) + "v-6\"/><text x=\"" + coordinate(kMargin + bar / 2) + "\" y=\"" +
         coordinate(height - 20) + "\" text-anchor=\"middle\">" +
         fixed(length, length >= 1 ? 0 : static_cast<int>(std::ceil(-std::log10(length)))) + " mm</text>";
  const double x = kWidth - 58, y = height - 14;
  svg += "<path class=\"axis\" d=\"M" + coordinate(x) + "," + coordinate(y - 22) + "V" + base + "H" +
         coordinate(x + 22) + "\"/><text x=\"" + coordinate(x + 32) + "\" y=\"" + coordinate(y + 4) +
         "\" text-anchor=\"middle\">" + "xyz"[section.right()] + "</text><text x=\"" + coordinate(x) +
         "\" y=\"" + coordinate(y - 28) + "\" text-anchor=\"middle\">" + "xyz"[section.up()] + "</text>";
  return svg + "</svg>";
}

}  // namespace gantry::report
