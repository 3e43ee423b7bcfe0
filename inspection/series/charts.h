#pragma once

#include <string>

#include "gantry/inspection/gauge.h"
#include "gantry/inspection/series.h"

namespace gantry::series {

/// An individuals chart above its moving ranges, as inline SVG. Runs that count for nothing are hollow;
/// points of a signal are red. The tolerance is drawn where it is near enough.
std::string control_chart_svg(const ControlChart& chart, const Series& series);

/// Features by runs, each cell in the colour of its deviation, as inline SVG.
std::string heat_map_svg(const std::vector<ControlChart>& charts, const Series& series);

/// The measurements of a gauge study, part by part, a colour for each appraiser, as inline SVG.
std::string gauge_points_svg(const GaugeResult& result, const GaugeReport& report);

/// What the tolerance is made of: bars of repeatability and reproducibility, as inline SVG.
std::string gauge_bars_svg(const std::vector<const GaugeResult*>& results);

}  // namespace gantry::series
