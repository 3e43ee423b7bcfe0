#pragma once

#include "pose_error.h"

namespace gantry::bench {

/// What errors of the poses the best of all methods would have left on these scans, that knew every surface's
/// normal exactly and where each point belongs (Cramer-Rao): `draws` draws from the covariance that the data
/// allow.
///
/// The part's surface is cut into elements of a millimetre, each with a height of its own that is not known;
/// what several scans say of it holds them together. Points count by the simulated sensor's noise, errors of
/// one pixel not counting for another. Edges, shadows, and where points are missing say nothing here, and the
/// tags no more than 15 mm and 15 degrees: a method that uses edges may do better where surfaces hold badly.
std::vector<PoseError> information_bound(const ScannedPart& part, const ScanSet& set,
                                         const SensorModel& sensor, size_t draws);

}  // namespace gantry::bench
