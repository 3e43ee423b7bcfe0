#pragma once

#include <fcl/geometry/bvh/BVH_model.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "gantry/geometry/triangle_mesh.h"

namespace gantry {

/// A mesh prepared for distances: a hierarchy of bounding volumes (FCL), a bounding sphere, and one vertex of
/// each connected shell.
class Solid {
 public:
  explicit Solid(const TriangleMesh& mesh);

  /// The centre of the bounding box, the sphere around it that holds the mesh, and the box's corners.
  const Eigen::Vector3d& centre() const { return centre_; }
  double radius() const { return radius_; }
  const Eigen::Matrix<double, 3, 8>& corners() const { return corners_; }

  /// Whether a point lies inside the closed shells, by the winding number (of an open mesh: nearly enclosed).
  bool contains(const Eigen::Vector3d& point) const;

  /// Distance of the surfaces, 0 where they meet; `b` is carried by `a_from_b`.
  friend double surface_distance(const Solid& a, const Solid& b, const Pose& a_from_b);
  /// Whether a shell of one is wholly inside the other, or crosses it where it is looked at: surfaces do not
  /// tell that.
  friend bool one_holds_other(const Solid& a, const Solid& b, const Pose& a_from_b);

 private:
  fcl::BVHModel<fcl::OBBRSSd> hierarchy_;
  TriangleMesh mesh_;
  Eigen::AlignedBox3d box_;
  Eigen::Vector3d centre_;
  double radius_ = 0;
  Eigen::Matrix<double, 3, 8> corners_;
  std::vector<Eigen::Vector3d> one_of_each_shell_;
};

double surface_distance(const Solid& a, const Solid& b, const Pose& a_from_b);
bool one_holds_other(const Solid& a, const Solid& b, const Pose& a_from_b);

}  // namespace gantry
