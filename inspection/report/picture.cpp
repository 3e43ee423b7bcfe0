#include "report/picture.h"

#include <algorithm>
#include <cmath>

#include "report/text.h"

namespace gantry::report {
namespace {

constexpr float kBadgeRadius = 16, kLeader = 52, kBadgeGap = 38, kBorder = 20;
constexpr int kStrip = 72;          // height below the picture for length bar and axes (pixels)
constexpr size_t kMostLabels = 24;  // more than this in one picture hide the part

/// The round length (1, 2 or 5 times a power of ten) next below `most`.
double round_length(double most) {
  const double power = std::pow(10.0, std::floor(std::log10(most)));
  for (const double factor : {5.0, 2.0})
    if (factor * power <= most) return factor * power;
  return power;
}

std::string point(float x, float y) {
  return coordinate(x) + "," + coordinate(y);
}

/// Below the picture, in its left corner.
std::string length_bar(const Camera& camera) {
  const double length = round_length(0.2 * camera.width * camera.mm_per_pixel);
  const double pixels = length / camera.mm_per_pixel, x = 24, y = camera.height + kStrip - 20;
  const std::string bar = coordinate(x) + "," + coordinate(y - 8) + "v8h" + coordinate(pixels) + "v-8";
  const int decimals = length >= 1 ? 0 : static_cast<int>(std::ceil(-std::log10(length)));
  return "<path class=\"bar\" d=\"M" + bar + "\"/><text class=\"small\" x=\"" + coordinate(x + pixels / 2) +
         "\" y=\"" + coordinate(y - 10) + "\" text-anchor=\"middle\">" + fixed(length, decimals) +
         " mm</text>";
}

/// Below the picture, in its right corner: where the CAD model's axes point.
std::string axes(const Camera& camera) {
  constexpr float kArm = 30, kName = 13;
  struct Arm {
    char name;
    Eigen::Vector2f step;
  };
  std::vector<Arm> arms;
  Eigen::AlignedBox2f box(Eigen::Vector2f::Zero());
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector2f step(camera.right[k], -camera.up[k]);
    if (step.norm() < 0.3f) continue;  // points at the viewer, or away
    arms.push_back({"xyz"[k], step});
    box.extend((kArm + kName / step.norm()) * step);
  }
  const Eigen::Vector2f origin =
      Eigen::Vector2f(camera.width - 24.0f, camera.height + kStrip - 18.0f) - box.max();
  std::string svg;
  for (const Arm& arm : arms) {
    const Eigen::Vector2f tip = origin + kArm * arm.step, name = tip + kName * arm.step.normalized();
    svg += "<path class=\"axis\" d=\"M" + point(origin.x(), origin.y()) + "L" + point(tip.x(), tip.y()) +
           "\"/>" + "<text class=\"small\" text-anchor=\"middle\" x=\"" + coordinate(name.x()) + "\" y=\"" +
           coordinate(name.y() + 6) + "\">" + arm.name + "</text>";
  }
  return svg;
}

std::string label_svg(const Picture::Label& label) {
  const Eigen::Vector2f step = label.badge - label.place;
  const Eigen::Vector2f start = label.badge - kBadgeRadius * step.stableNormalized();
  const std::string line = "M" + point(start.x(), start.y()) + "L" + point(label.place.x(), label.place.y());
  return "<path class=\"halo\" d=\"" + line + "\"/><path class=\"leader\" d=\"" + line + "\"/>" +
         "<circle class=\"dot\" cx=\"" + coordinate(label.place.x()) + "\" cy=\"" +
         coordinate(label.place.y()) + "\" r=\"4\"/><circle class=\"badge\" cx=\"" +
         coordinate(label.badge.x()) + "\" cy=\"" + coordinate(label.badge.y()) + "\" r=\"" +
         coordinate(kBadgeRadius) + "\"/><text class=\"number\" x=\"" + coordinate(label.badge.x()) +
         "\" y=\"" + coordinate(label.badge.y() + 6) + "\">" + std::to_string(label.defect) + "</text>";
}

std::string cross_hair_svg(const Eigen::Vector2f& p) {
  const std::string lines =
      "M" + point(p.x() - 17, p.y()) + "h10m14,0h10M" + point(p.x(), p.y() - 17) + "v10m0,14v10";
  const auto ring = [&](const char* style) {
    return std::string("<circle class=\"") + style + "\" cx=\"" + coordinate(p.x()) + "\" cy=\"" +
           coordinate(p.y()) + "\" r=\"7\"/><path class=\"" + style + "\" d=\"" + lines + "\"/>";
  };
  return ring("halo") + ring("leader");
}

/// Badges move apart until none covers another, or another's place.
void separate(std::vector<Picture::Label>& labels, const Camera& camera) {
  const Eigen::Vector2f low(kBorder, kBorder), high(camera.width - kBorder, camera.height - kBorder);
  for (int round = 0; round < 100; ++round) {
    for (size_t i = 0; i < labels.size(); ++i)
      for (size_t j = 0; j < labels.size(); ++j) {
        if (i == j) continue;
        const Eigen::Vector2f apart = labels[i].badge - labels[j].badge;
        if (const float d = apart.norm(); i < j && d < kBadgeGap) {
          const Eigen::Vector2f push =
              0.5f * (kBadgeGap - d) * (d > 1e-3f ? Eigen::Vector2f(apart / d) : Eigen::Vector2f(0, 1));
          labels[i].badge += push;
          labels[j].badge -= push;
        }
        const Eigen::Vector2f off = labels[i].badge - labels[j].place;
        if (const float d = off.norm(); d < 24)
          labels[i].badge += (24 - d) * (d > 1e-3f ? Eigen::Vector2f(off / d) : Eigen::Vector2f(1, 0));
      }
    for (auto& label : labels) label.badge = label.badge.cwiseMax(low).cwiseMin(high);
  }
}

}  // namespace

std::vector<Picture::Label> place_labels(const Camera& camera, const Rendering& rendering,
                                         const MeasuredSurface& measured,
                                         const std::vector<Defect>& defects) {
  struct Seen {
    size_t total = 0, visible = 0;
    float best = 1e30f;
    Eigen::Vector2f place;
  };
  std::vector<Seen> seen(defects.size());
  for (const auto* surfels : {&measured.on_cad, &measured.off_cad})
    for (const Surfel& surfel : *surfels) {
      if (surfel.defect < 1 || surfel.defect > static_cast<int>(defects.size())) continue;
      Seen& s = seen[surfel.defect - 1];
      ++s.total;
      if (!rendering.shows(camera, surfel)) continue;
      ++s.visible;
      const float d = (surfel.position - defects[surfel.defect - 1].peak_at_mm.cast<float>()).squaredNorm();
      if (d >= s.best) continue;
      s.best = d;
      s.place = camera.project(surfel.position).head<2>();
    }
  const Eigen::Vector2f middle(0.5f * camera.width, 0.5f * camera.height);
  std::vector<Picture::Label> labels;
  for (size_t i = 0; i < defects.size() && labels.size() < kMostLabels; ++i) {
    // A sliver of a region round a corner is not worth a label.
    if (seen[i].visible < 2 || seen[i].visible * 20 < seen[i].total) continue;
    Eigen::Vector2f outwards = (seen[i].place - middle).stableNormalized();
    if (outwards.norm() < 0.5f) outwards = Eigen::Vector2f(0.7f, -0.7f);
    labels.push_back({defects[i].id, seen[i].place, seen[i].place + kLeader * outwards});
  }
  separate(labels, camera);
  return labels;
}

std::string picture_svg(const Picture& picture, const std::string& id) {
  const std::string size = "width=\"" + std::to_string(picture.camera.width) + "\" height=\"" +
                           std::to_string(picture.camera.height) + "\"";
  std::string svg = "<svg class=\"view\" id=\"" + id + "\" role=\"img\" aria-label=\"" +
                    escaped(picture.name) + "\" viewBox=\"0 0 " + std::to_string(picture.camera.width) + " " +
                    std::to_string(picture.camera.height + kStrip) + "\"><image " + size +
                    " href=\"data:image/png;base64," + base64(picture.png) + "\"/>";
  svg += length_bar(picture.camera) + axes(picture.camera);
  if (picture.cross_hair) {
    for (const auto& label : picture.labels) svg += cross_hair_svg(label.place);
  } else {
    for (const auto& label : picture.labels) svg += label_svg(label);
  }
  return svg + "</svg>";
}

}  // namespace gantry::report
