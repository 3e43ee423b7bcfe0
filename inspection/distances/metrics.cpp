// Names and meaning of the metrics.

#include <algorithm>
#include <array>

#include "gantry/inspection/distances.h"

namespace gantry {
namespace {

struct Entry {
  Metric metric;
  std::string_view name, unit;
};
constexpr std::array kEntries = {Entry{Metric::kChamfer, "chamfer", "mm"},
                                 Entry{Metric::kChamferSquared, "chamfer-squared", "mm2"},
                                 Entry{Metric::kHausdorff, "hausdorff", "mm"},
                                 Entry{Metric::kPercentileHausdorff, "percentile-hausdorff", "mm"},
                                 Entry{Metric::kEarthMovers, "emd", "mm"},
                                 Entry{Metric::kPlane, "plane", "mm"},
                                 Entry{Metric::kQuadric, "quadric", "mm"},
                                 Entry{Metric::kTriangulation, "triangulation", "mm"},
                                 Entry{Metric::kCloudToMesh, "cloud-to-mesh", "mm"},
                                 Entry{Metric::kM3c2, "m3c2", "mm"}};

const Entry& entry_of(Metric metric) {
  return *std::find_if(kEntries.begin(), kEntries.end(), [&](const Entry& e) { return e.metric == metric; });
}

}  // namespace

std::span<const Metric> all_metrics() {
  static const auto all = [] {
    std::array<Metric, kEntries.size()> metrics{};
    std::transform(kEntries.begin(), kEntries.end(), metrics.begin(),
                   [](const Entry& e) { return e.metric; });
    return metrics;
  }();
  return all;
}

std::string_view to_string(Metric metric) {
  return entry_of(metric).name;
}

std::string_view unit_of(Metric metric) {
  return entry_of(metric).unit;
}

std::optional<Metric> metric_named(std::string_view name) {
  for (const Entry& e : kEntries)
    if (e.name == name) return e.metric;
  return std::nullopt;
}

}  // namespace gantry
