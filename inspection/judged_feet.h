#pragma once

#include <cmath>
#include <vector>

#include "gantry/geometry/signed_distance.h"

namespace gantry::internal {

/// Where the points of a cloud stand on the CAD surface, in the cloud's order.
struct JudgedFeet {
  std::vector<Eigen::Vector3f> point;
  std::vector<int> triangle;  ///< -1: the point is not judged, `point` means nothing.
  /// 1: the point is out of tolerance and lies sideways of the triangle that it stands on: beside the
  /// surface, in a hole or beyond an edge, where it says nothing of the CAD surface.
  std::vector<unsigned char> beside;

  explicit JudgedFeet(size_t points) : point(points), triangle(points, -1), beside(points, 0) {}

  /// Point `i`, at `from`, stands where `value` says. `facing`: its normal, or null.
  void stand(size_t i, const SignedDistance::Value& value, const Eigen::Vector3f& from,
             const Eigen::Vector3f* facing, const TriangleMesh& mesh, double tolerance_mm) {
    point[i] = value.closest;
    triangle[i] = value.triangle;
    const Eigen::Vector3f normal = mesh.normal(static_cast<size_t>(value.triangle));
    const float across = normal.dot(from - value.closest);
    beside[i] =
        std::abs(value.distance) > static_cast<float>(tolerance_mm) &&
        (std::abs(across) < 0.5f * std::abs(value.distance) || (facing && facing->dot(normal) < 0.5f));
  }
};

}  // namespace gantry::internal
