#pragma once

#include <span>
#include <string>
#include <vector>

#include "gantry/fusion/overlap.h"
#include "gantry/fusion/registration.h"

namespace gantry {

/// Mean of a scan's points, sensor frame.
Eigen::Vector3d centroid(const ScanSurface& surface);

/// How far (mm, one sigma) the tagged poses leave two scans apart, at the middle of their surfaces.
double relative_sigma_mm(const ScanSurface& a, const ScanSurface& b);

/// The pairs to register at the tagged poses; the cells are as wide as the poses are uncertain.
std::vector<OverlappingPair> pairs_at_tags(std::span<const ScanSurface> surfaces, double min_overlap);

/// Search radius that covers three sigma of a pair's tagged poses, but no more than a sixth of the scans'
/// extent: beyond that, matches tell nothing.
double start_radius_mm(const ScanSurface& a, const ScanSurface& b);

/// "not connected to the first scan by any usable overlap: NAMES", or empty when every scan is reached
/// from the first through the kept pairs.
std::string unconnected_scans(std::span<const ScanSurface> surfaces, const std::vector<PairReport>& pairs);

}  // namespace gantry
