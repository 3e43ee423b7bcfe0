#pragma once

#include "gantry/fusion/range_surface.h"

namespace gantry::internal {

/// Lays the kept points of a scan out as a range image, cut out to what holds data: sets the rays,
/// width, height, w and the kSeen flags. Returns whether it is the scan's own grid.
///
/// The scan's own grid is used when its rays can be told. Points without a usable grid are given one:
/// a virtual sensor at the origin when they can have been seen from there, otherwise one with parallel
/// rays along the direction in which the fewest points hide others. Its pixels are about as wide as the
/// points' spacing; points that share one are averaged, those behind others are dropped and counted.
bool lay_out(const Scan& scan, const std::vector<unsigned char>& keep, RangeSurface& surface);

}  // namespace gantry::internal
