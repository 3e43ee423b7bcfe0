#pragma once

#include <optional>
#include <vector>

#include "gantry/fusion/range_surface.h"

namespace gantry::internal {

struct PixelSample {
  Eigen::Vector2d pixel;
  Eigen::Vector3d point;  ///< In the sensor frame.
};

struct FittedRays {
  RayModel rays;
  Pose sensor_from_grid = Pose::Identity();
  bool sensor_known = true;  ///< False for parallel rays: their direction is known, its sign is guessed.
};

/// Finds how the pixels of a grid look, from points that were measured through them: rays that meet in
/// the origin; rays that meet elsewhere (points given in another frame than the sensor's); parallel rays.
/// Nothing when none explains the grid within a tenth of a pixel.
std::optional<FittedRays> fit_rays(const std::vector<PixelSample>& samples);

}  // namespace gantry::internal
