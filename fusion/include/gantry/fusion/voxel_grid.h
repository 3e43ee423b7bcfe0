#pragma once

#include "gantry/fusion/preprocess.h"

namespace gantry {

/// The paper's downsampling ("Pose Graph Parameters"): all points of a cubic cell become one, their
/// average. Here a cell holds one average for each of the six main directions of normals, so that the
/// faces of an edge or a thin wall do not melt into one. Averages are weighted by 1 / sigma^2; sigma_mm
/// becomes that of the mean, spacing_mm the cell's edge. A centroid lies on the rim when most of its points
/// do. Averages of a curved surface lie beside it: good for capture, biased by about voxel^2 / (16 radius).
/// Throws InputError when `voxel_mm` is not positive, or so small that the cells cannot be numbered.
ScanSurface voxel_downsample(const ScanSurface& surface, double voxel_mm);

}  // namespace gantry
