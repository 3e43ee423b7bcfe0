#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "detection_curve.h"

namespace gantry::bench {

/// Probability of detection against depth (logarithmic): fitted curves, and the shares that were found as
/// circles.
struct DetectionChart {
  struct Series {
    std::string name;
    std::optional<DetectionCurve> curve;
    std::vector<Trial> trials;
  };
  std::string title;
  double tolerance_mm = 0;  ///< Drawn as a dashed line.
  std::vector<Series> series;
};
void save_detection_chart(const std::filesystem::path& path, const DetectionChart& chart);

}  // namespace gantry::bench
