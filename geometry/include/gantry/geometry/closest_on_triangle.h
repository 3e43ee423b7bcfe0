#pragma once

#include <Eigen/Core>

namespace gantry {

/// Where on a triangle (corners 0, 1, 2) a point lies.
enum class TriangleFeature : unsigned char { kFace, kEdge01, kEdge12, kEdge20, kVertex0, kVertex1, kVertex2 };

/// The point of triangle abc that is closest to p, and the feature it lies on (after Ericson, Real-Time
/// Collision Detection, 5.1.5, but with the areas as products with the normal: the differences of products
/// that he takes cost a sliver all their digits). Of a triangle without area the point may be any of it.
inline Eigen::Vector3d closest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                           const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                                           TriangleFeature& feature) {
  using Feature = TriangleFeature;
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return feature = Feature::kVertex0, a;
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return feature = Feature::kVertex1, b;
  const Eigen::Vector3d n = ab.cross(ac);
  const double vc = n.dot(ab.cross(ap));
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return feature = Feature::kEdge01, a + d1 / (d1 - d3) * ab;
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return feature = Feature::kVertex2, c;
  const double vb = n.dot(ap.cross(ac));
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return feature = Feature::kEdge20, a + d2 / (d2 - d6) * ac;
  const double va = n.dot((c - b).cross(bp));
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    return feature = Feature::kEdge12, b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  }
  return feature = Feature::kFace, p - n * (n.dot(ap) / n.squaredNorm());
}

}  // namespace gantry
