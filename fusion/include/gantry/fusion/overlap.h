#pragma once

#include "gantry/fusion/preprocess.h"

namespace gantry {

/// How much surface two scans have in common, as a fraction of the smaller one's, from their tagged
/// poses alone: occupied cells of a coarse grid in the part frame, told apart by the direction of the
/// normal, so that the two faces of a wall do not count as common. `cell_mm` should be a few times
/// the error of the tagged poses.
double predicted_overlap(const ScanSurface& a, const ScanSurface& b, double cell_mm);

}  // namespace gantry
