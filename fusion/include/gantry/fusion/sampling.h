#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "gantry/fusion/preprocess.h"

namespace gantry {

/// How points are chosen to be matched (Glira et al. 2015, "A correspondence framework for ALS strip
/// adjustments based on variants of the ICP algorithm", section on selection).
enum class SamplingStrategy {
  kUniform,         ///< Evenly spread over the surface: one point of each cell of a grid.
  kRandom,          ///< Each measured point is as likely as any other.
  kNormalSpace,     ///< All directions of normals alike (Rusinkiewicz and Levoy 2001): a small flange holds a
                    ///< plate.
  kMaximumLeverage  ///< Those that most constrain the six parameters of the pose.
};

std::string_view to_string(SamplingStrategy strategy);

/// Indices of at most `count` points in rising order; points on the rim are not taken. The same arguments
/// give the same points. `count` 0 or more than there are: all that are not on the rim.
std::vector<uint32_t> sample_points(const ScanSurface& surface, SamplingStrategy strategy, size_t count);

}  // namespace gantry
