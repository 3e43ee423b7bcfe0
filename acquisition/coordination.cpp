#include "gantry/acquisition/coordination.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace gantry {

CoordinatedMove coordinate(std::span<const double> from, std::span<const double> to,
                           std::span<const AxisLimits> limits) {
  // Of the path parameter s, which runs from 0 to 1: its speed and acceleration.
  double rate = std::numeric_limits<double>::infinity(), growth = rate;
  for (size_t i = 0; i < to.size(); ++i) {
    const double distance = std::abs(to[i] - from[i]);
    if (distance == 0) continue;
    rate = std::min(rate, limits[i].speed / distance);
    growth = std::min(growth, limits[i].acceleration / distance);
  }
  CoordinatedMove move;
  for (size_t i = 0; i < to.size(); ++i) {
    const double distance = std::abs(to[i] - from[i]);
    if (distance == 0)
      move.axes.push_back({to[i], limits[i].speed, limits[i].acceleration});
    else
      move.axes.push_back({to[i], rate * distance, growth * distance});
  }
  if (std::isfinite(rate))
    move.duration_s = rate * rate < growth ? 1 / rate + rate / growth : 2 / std::sqrt(growth);
  return move;
}

}  // namespace gantry
