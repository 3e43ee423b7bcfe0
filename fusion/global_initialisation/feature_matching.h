#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gantry/geometry/point_cloud.h"

namespace gantry {

/// Indices of two points whose surroundings look alike.
struct Correspondence {
  uint32_t target, source;
};

/// Each point's nearest in the space of features (FPFH at `radius_mm` and at twice that), both ways,
/// without repetition. The `max_count` most telling are kept: those that are closer to each other than
/// to the mean feature, which is that of a flat patch. Distances are computed all against all: at 66
/// dimensions a search tree visits most points anyway, and a matrix product is faster.
std::vector<Correspondence> match_features(const PointCloud& target, const PointCloud& source,
                                           double radius_mm, size_t max_count);

}  // namespace gantry
