#pragma once

#include <optional>
#include <vector>

#include "alignment/distance_field.h"
#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/signed_distance.h"

namespace gantry::internal {

/// A pose that came to rest on the model.
struct FoundPose {
  Pose cad_from_cloud = Pose::Identity();
  double cost = 1;  ///< Mean over the points of (distance / reach)^2, at most 1 each: 0 is perfect.
};

/// Places a cloud that may lie anywhere, turned by any angle.
///
///  1. Rotations that cover SO(3) evenly, about 13 degrees apart (Alexa, "Super-Fibonacci spirals", 2022),
///     each with the centroids and with the middles of the bounding boxes laid onto each other.
///  2. A few hundred points, one per cell of a grid, are drawn to the model by look-ups in a DistanceField;
///     the better quarter goes on.
///  3. The best that are distinct are fitted point to plane with the faces themselves, sides told apart, in
///     two passes of falling reach, and ranked by their truncated cost.
///
/// Best first. A part seen in small portions only, or symmetric up to small features that a defect hides, may
/// be placed wrongly.
std::vector<FoundPose> find_poses(const PointCloud& cloud, const SignedDistance& model);

/// The best of find_poses(); nothing when less than half of the points lie on the model in it.
std::optional<Pose> find_pose(const PointCloud& cloud, const SignedDistance& model);

/// Draws points to the model by look-ups, as far as `reach_mm`, and states what that came to.
void settle(const PointCloud& cloud, const DistanceField& field, double reach_mm, int steps,
            FoundPose& found);

/// One point per cell of a grid, so that about `count` remain however uneven the cloud is.
PointCloud thinned(const PointCloud& cloud, size_t count);

/// `count` rotations that cover SO(3) evenly.
std::vector<Eigen::Matrix3d> even_rotations(size_t count);

}  // namespace gantry::internal
