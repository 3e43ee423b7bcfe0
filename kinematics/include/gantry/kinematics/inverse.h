#pragma once

#include <optional>
#include <span>
#include <vector>

#include "gantry/kinematics/chain.h"

namespace gantry {

/// A wanted view of the part: where the sensor is and where it looks, both in the part frame. The roll
/// about the viewing direction is free.
struct ViewTarget {
  Eigen::Vector3d sensor_position_mm;
  Eigen::Vector3d viewing_direction;  ///< Unit vector, out of the lens.
};

struct InverseResult {
  std::vector<double> q;           ///< Joint values, within the limits.
  double position_error_mm = 0;    ///< What remains of the wanted position ...
  double direction_error_rad = 0;  ///< ... and direction: three joints cannot reach every view.
};

/// The joint values within [lower, upper] whose view is nearest to the wanted one, by damped least
/// squares from a grid of starts; direction is weighted as if it acted on the part at 100 mm.
InverseResult nearest_view(const Chain& chain, const ViewTarget& target, std::span<const double> lower,
                           std::span<const double> upper);

}  // namespace gantry
