#pragma once

#include "joint/matches.h"

namespace gantry::internal {

/// Between its pixels a scan's surface is taken as straight. How far such chords lie inside a bent surface
/// follows from the normals around; over the matches of one scan on another it is an error that all share
/// (creases and rounded edges hold what flat faces let slide), and no scatter shows it.
///
/// Returns sum w a e over all matches, e being that distance: the gradient that chords alone would make, in
/// the part frame about `centre`, as PairSum::gradient; from every fourth row and column of the source.
Vector6d chord_errors(const RangeSurface& target, const RangeSurface& source, const Pose& target_from_source,
                      const Pose& part_from_target, const Eigen::Vector3d& centre, const MatchGates& gates);

}  // namespace gantry::internal
