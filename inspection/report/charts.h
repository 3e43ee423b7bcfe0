#pragma once

#include <string>

#include "report/colour_scale.h"
#include "report/distribution.h"

namespace gantry::report {

enum class CountAxis {
  kLinear,      ///< Shows the good surface, a little beyond the tolerance.
  kLogarithmic  ///< Shows the few points of a defect beside the many good ones, up to the largest deviations.
};

/// The histogram as inline SVG, with the Gaussians and the tolerance lines.
std::string histogram_svg(const Distribution& distribution, const ColourScale& colours, CountAxis axis);

/// The histogram of the magnitudes with the Weibull density, as inline SVG.
std::string magnitudes_svg(const Distribution& distribution, const ColourScale& colours);

/// The colour bar with its ticks in mm, as inline SVG.
std::string legend_svg(const ColourScale& colours);

}  // namespace gantry::report
