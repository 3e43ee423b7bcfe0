#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry::bench {

/// A round dent in the plate's top: depth (1 + cos(pi r / radius)) / 2, so that it has no edge.
struct Dent {
  double depth_mm = 0, diameter_mm = 0;
  Eigen::Vector2d centre_mm = Eigen::Vector2d::Zero();
};

/// A plate of 120 x 90 x 5 mm; its top, in z = 0, is a grid of 0.3 mm whose vertices the dents displace.
TriangleMesh dented_plate(const std::vector<Dent>& dents);

/// Places for so many dents on the top, 15 mm from each other and 9 mm from the edges, each moved at random
/// by up to 2 mm: a dent never meets pixels and cells the same way. At most 35.
std::vector<Eigen::Vector2d> dent_places(size_t count, uint64_t seed);

/// The plate scanned from four sides above by the simulated sensor and merged at the true poses. `seed` also
/// moves the views, by up to 5 mm and 2 degrees.
PointCloud scanned_plate(const TriangleMesh& plate, uint64_t seed);

}  // namespace gantry::bench
