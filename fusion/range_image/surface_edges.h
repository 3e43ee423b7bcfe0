#pragma once

#include <vector>

#include "gantry/fusion/range_surface.h"

namespace gantry::internal {

/// Finds where a scan's surface ends (see SurfaceEdge). Around every pixel at the border of the usable
/// data, the pixels of a small window that lie on its tangent plane must fill one side of a straight line,
/// and the rest must be empty background or surface far behind; the line is placed to a fraction of a pixel
/// by how many they are. Windows that reach past the image, past the crop box, or to something in front
/// (whose border it then is) say nothing; nor do gaps that end at something in front, which may be its shadow.
///
/// `measured` is the depth coordinate as it was before any pixel was dropped; `noise_w` its standard
/// deviation; `pitch` the width of a pixel in units of (u, v).
std::vector<SurfaceEdge> find_edges(const RangeSurface& surface, const std::vector<float>& measured,
                                    float noise_w, float pitch);

}  // namespace gantry::internal
