#pragma once

#include <string>
#include <vector>

#include "gantry/inspection/inspection.h"
#include "report/colour_scale.h"

namespace gantry::report {

/// How the judged deviations are distributed: sorted values and two Gaussians that describe them.
struct Distribution {
  struct Gaussian {
    double mean_mm = 0, sigma_mm = 0;
  };

  std::vector<float> sorted_mm;
  Gaussian all;   ///< Mean and sigma of all judged points.
  Gaussian bulk;  ///< Median and scaled MAD: of the good surface, which defects hardly move.
};

Distribution distribution(const InspectionResult& result);

enum class CountAxis {
  kLinear,      ///< Shows the good surface, a little beyond the tolerance.
  kLogarithmic  ///< Shows the few points of a defect beside the many good ones, up to the largest deviations.
};

/// The histogram as inline SVG, with the Gaussians and the tolerance lines.
std::string histogram_svg(const Distribution& distribution, const ColourScale& colours, CountAxis axis);

/// The colour bar with its ticks in mm, as inline SVG.
std::string legend_svg(const ColourScale& colours);

}  // namespace gantry::report
