#pragma once

#include <cstdint>
#include <string>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/triangle_mesh.h"

namespace gantry::bench {

/// The paper's surfaces over x, y in [0, 1] m; their height depends on x only.
enum class Shape { kPlane, kSlope, kSine, kTriangularWave };
inline constexpr Shape kShapes[] = {Shape::kPlane, Shape::kSlope, Shape::kSine, Shape::kTriangularWave};
std::string to_string(Shape shape);

inline constexpr double kMetre_mm = 1000;
/// How far the copy is moved along z: the truth that the metrics are held against.
inline constexpr double kShift_m = 0.5;

/// In mm: plane z = 0; slope 0.5 x; sine and triangular wave of amplitude 0.1 m and two periods. In 16
/// segments along x, which a triangular wave needs and which makes the sine a polygon.
TriangleMesh shape_mesh(Shape shape);

/// What is done to the copy.
struct Perturbation {
  double noise_m = 0;          ///< Standard deviation of each coordinate.
  double hole_m = 0;           ///< Points within this of the centroid in x, y are missing.
  double sampling_factor = 1;  ///< One point in so many is kept, chosen at random.

  bool clean() const { return noise_m == 0 && hole_m == 0 && sampling_factor == 1; }
};

/// The same points kShift_m higher, perturbed.
PointCloud perturbed_copy(const PointCloud& cloud, const Perturbation& perturbation, uint64_t seed);

}  // namespace gantry::bench
