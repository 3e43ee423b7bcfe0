#pragma once

#include <span>
#include <vector>

#include "gantry/fusion/range_surface.h"

namespace gantry {

/// Agreement of all scans that share surface, at given poses. A sample of each scan's points is matched to
/// the nearest point of every other scan, within 2 mm, normals within 45 degrees, not on the rim; distances
/// are taken along the partner's normal, the worst tenth dropped. It needs no truth, and means the same
/// for every method of registration.
struct OverlapResidual {
  double rms_mm = 0;
  size_t matches = 0;
};

/// `part_from_sensor` has a pose for each scan. `rms_of_scan_mm` (optional): the same over the pairs of each
/// scan, 0 for a scan without matches. The nearest point is sought around the pixel that the point falls
/// into, which needs no search tree. The same for any number of threads.
OverlapResidual overlap_residual(std::span<const RangeSurface> scans, std::span<const Pose> part_from_sensor,
                                 std::vector<double>* rms_of_scan_mm = nullptr);

}  // namespace gantry
