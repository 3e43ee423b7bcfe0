#pragma once

#include <string>

#include "report/colour_scale.h"
#include "report/sections.h"

namespace gantry::report {

/// How many times too large deviations are drawn in a section, so that the tolerance and most deviations are
/// well seen and the part is still recognised: 1, 2 or 5 times a power of ten.
double exaggeration(const Section& section, double tolerance_mm);

/// "A: x = 12.3 mm, seen from +x".
std::string section_name(const Section& section);

/// The nominal outline with its tolerance band, and what was measured, as inline SVG.
std::string section_svg(const Section& section, const ColourScale& colours);

}  // namespace gantry::report
