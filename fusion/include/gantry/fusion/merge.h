#pragma once

#include <vector>

#include "gantry/fusion/preprocess.h"

namespace gantry {

struct MergeOptions {
  double voxel_mm = 0;     ///< Edge of the averaging cells; 0: 1.1 times the median point spacing.
  size_t min_support = 4;  ///< Cells that hold, with the 26 around them, fewer measurements are outliers.
};

/// One cloud in the part frame from all scans: points of a cell whose normals agree become one, weighted
/// by 1 / sigma^2, with the averaged normal and the sigma of the weighted mean. Cells are kept apart by
/// the direction of the normal, so that faces of a thin wall never merge. The order of the points does
/// not depend on the number of threads. `voxel_used_mm` (optional) tells the cell size.
PointCloud merge_surfaces(const std::vector<ScanSurface>& surfaces, const std::vector<Pose>& part_from_sensor,
                          const MergeOptions& options, double* voxel_used_mm = nullptr);

}  // namespace gantry
