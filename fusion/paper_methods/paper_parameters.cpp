#include "gantry/fusion/paper_parameters.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

/// The paper: below this a scan has too few points to lose any.
constexpr double kFewPoints = 100000;
/// Averages that keep a scan's structure and are quick to match: what the paper's 2 mm leaves of a scan of
/// a few hundred thousand points on a part of the bunny's size.
constexpr double kWantedCentroids = 6000;
constexpr double kAutomaticM = 2, kAutomaticP = 3;

std::string text(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.4g", value);
  return buffer;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void check(double value, const char* key, double low, double high) {
  if (value == 0) return;
  if (!std::isfinite(value) || value < low || value > high)
    throw InputError(std::string(key) + ": must be " +
                     (std::isinf(high) ? "a positive length" : "in [" + text(low) + ", " + text(high) + "]") +
                     ", or 0 to choose it from the data; found " + text(value));
}

}  // namespace

ResolvedParameters resolve(const PaperParameters& given, std::span<const ScanSurface> surfaces) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  check(given.voxel_size_mm, "voxel_size_mm", std::numeric_limits<double>::min(), kInfinity);
  check(given.m, "m", 1, 4);
  check(given.p, "p", 2, 4);
  check(given.max_distance_threshold_mm, "max_distance_threshold_mm", std::numeric_limits<double>::min(),
        kInfinity);
  check(given.edge_prune_threshold_mm, "edge_prune_threshold_mm", std::numeric_limits<double>::min(),
        kInfinity);
  if (given.m != 0 && given.max_distance_threshold_mm != 0)
    throw InputError("m and max_distance_threshold_mm: give one of them, they say the same");
  if (given.p != 0 && given.edge_prune_threshold_mm != 0)
    throw InputError("p and edge_prune_threshold_mm: give one of them, they say the same");
  if (surfaces.empty()) throw InputError("registration: there is no scan to register");

  std::vector<double> points, spacings, areas;
  for (const ScanSurface& s : surfaces) {
    points.push_back(static_cast<double>(s.cloud.size()));
    spacings.push_back(s.spacing_mm);
    areas.push_back(points.back() * s.spacing_mm * s.spacing_mm);
  }
  const double count = median(points), spacing_mm = median(spacings), area_mm2 = median(areas);

  ResolvedParameters out;
  const auto choose = [&](const char* name, double value, std::string reason) {
    out.choices.push_back({name, value, std::move(reason)});
    return value;
  };
  if (given.voxel_size_mm != 0) {
    out.downsample = count >= kFewPoints;
    if (out.downsample && given.voxel_size_mm < spacing_mm)
      throw InputError("voxel_size_mm: must be at least the point spacing, " + text(spacing_mm) +
                       " mm; found " + text(given.voxel_size_mm));
    out.voxel_size_mm = choose(
        "voxel_size_mm", given.voxel_size_mm,
        out.downsample ? "as given"
                       : "as given; only scales the thresholds: scans of " + text(count) +
                             " points are not downsampled (the paper: below " + text(kFewPoints) + ")");
  } else {
    const double wanted_mm = std::sqrt(area_mm2 / kWantedCentroids);
    out.downsample = wanted_mm > spacing_mm;
    out.voxel_size_mm = choose(
        "voxel_size_mm", std::max(wanted_mm, spacing_mm),
        out.downsample
            ? "leaves about " + text(kWantedCentroids) + " averages of a scan's " + text(count) + " points"
            : "the point spacing: scans of " + text(count) + " points are not downsampled");
  }
  if (given.max_distance_threshold_mm != 0) {
    const double m = given.max_distance_threshold_mm / out.voxel_size_mm;
    out.max_distance_threshold_mm = choose(
        "max_distance_threshold_mm", given.max_distance_threshold_mm,
        m >= 1 && m <= 4 ? "as given" : "as given; m = " + text(m) + " lies outside the paper's [1, 4]");
  } else {
    const double m = given.m != 0 ? given.m : kAutomaticM;
    out.max_distance_threshold_mm =
        choose("max_distance_threshold_mm", m * out.voxel_size_mm,
               "voxel_size * m with m = " + text(m) +
                   (given.m != 0 ? " as given"
                                 : ": where the search radius ends; it begins at what the tagged "
                                   "poses' covariance allows"));
  }
  out.fixed_distance = given.m != 0 || given.max_distance_threshold_mm != 0;
  if (given.edge_prune_threshold_mm != 0) {
    const double p = out.voxel_size_mm / given.edge_prune_threshold_mm;
    out.edge_prune_threshold_mm = choose(
        "edge_prune_threshold_mm", given.edge_prune_threshold_mm,
        p >= 2 && p <= 4 ? "as given" : "as given; p = " + text(p) + " lies outside the paper's [2, 4]");
  } else {
    const double p = given.p != 0 ? given.p : kAutomaticP;
    out.edge_prune_threshold_mm = choose(
        "edge_prune_threshold_mm", out.voxel_size_mm / p,
        "voxel_size / p with p = " + text(p) + (given.p != 0 ? " as given" : ", the middle of [2, 4]"));
  }
  return out;
}

double line_process_confidence(double disagreement_mm, double max_distance_threshold_mm) {
  const double ratio = disagreement_mm / max_distance_threshold_mm;
  return 1 / ((1 + ratio * ratio) * (1 + ratio * ratio));
}

double disagreement_at_confidence_mm(double confidence, double max_distance_threshold_mm) {
  if (!(confidence > 0 && confidence <= 1))
    throw InputError("confidence: must be in (0, 1], found " + text(confidence));
  return max_distance_threshold_mm * std::sqrt(1 / std::sqrt(confidence) - 1);
}

}  // namespace gantry
