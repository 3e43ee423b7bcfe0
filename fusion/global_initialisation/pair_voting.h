#pragma once

#include <cstddef>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"

namespace gantry {

/// A pose that many pairs of points voted for.
struct VotedPose {
  Pose target_from_source = Pose::Identity();
  double votes = 0;
};

/// Point pair features and voting (Drost, Ulrich, Navab, Ilic, "Model Globally, Match Locally", CVPR
/// 2010): a pair of oriented points is described by its length and three angles, equal pairs of target
/// and source say where the source may lie, and the poses that gather most votes are returned, most
/// votes first, similar ones joined. Where a local feature sees only one more flat patch or one more bend,
/// pairs across the whole surface still tell. Pairs in one plane, which are many and say little, are
/// left out. Both clouds hold unit normals; `distance_step_mm` is the width of a bin of lengths.
std::vector<VotedPose> vote_by_point_pairs(const PointCloud& target, const PointCloud& source,
                                           double distance_step_mm, size_t max_poses);

}  // namespace gantry
