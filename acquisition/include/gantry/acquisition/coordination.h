#pragma once

#include <span>
#include <vector>

#include "gantry/hal/axis.h"

namespace gantry {

/// A move of all axes that starts and arrives together: every axis follows the same trapezoid in time,
/// scaled to its distance, so that the joints run along a straight line in joint space.
struct CoordinatedMove {
  std::vector<MoveCommand> axes;
  double duration_s = 0;  ///< Of the ramps, without settling.
};

/// The fastest one that keeps every axis within its speed and acceleration. The line is exact for
/// drives that follow trapezoids and start at once. A drive that starts `d` s later than another lags behind
/// the line by up to its own speed times `d`; docs/motion.md says what that comes to.
CoordinatedMove coordinate(std::span<const double> from, std::span<const double> to,
                           std::span<const AxisLimits> limits);

}  // namespace gantry
