#include "shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace gantry::bench {
namespace {

constexpr int kSegments = 16;
constexpr double kAmplitude_m = 0.1, kPeriods = 2, kSlope = 0.5;

double height_m(Shape shape, double x_m) {
  const double phase = kPeriods * x_m;
  switch (shape) {
    case Shape::kPlane:
      return 0;
    case Shape::kSlope:
      return kSlope * x_m;
    case Shape::kSine:
      return kAmplitude_m * std::sin(2 * std::numbers::pi * phase);
    case Shape::kTriangularWave:  // rises from 0 as the sine does
      return kAmplitude_m * (1 - 4 * std::abs(phase - std::floor(phase + 0.25) - 0.25));
  }
  return 0;
}

}  // namespace

std::string to_string(Shape shape) {
  switch (shape) {
    case Shape::kPlane:
      return "plane";
    case Shape::kSlope:
      return "slope";
    case Shape::kSine:
      return "sine";
    case Shape::kTriangularWave:
      return "triangle";
  }
  return {};
}

TriangleMesh shape_mesh(Shape shape) {
  TriangleMesh mesh;
  for (int i = 0; i <= kSegments; ++i) {
    const double x = static_cast<double>(i) / kSegments;
    for (const double y : {0.0, 1.0})
      mesh.vertices.push_back((kMetre_mm * Eigen::Vector3d(x, y, height_m(shape, x))).cast<float>());
    if (i == 0) continue;
    const int near = 2 * (i - 1), far = 2 * i;  // triangles face upwards
    mesh.triangles.emplace_back(near, far, far + 1);
    mesh.triangles.emplace_back(near, far + 1, near + 1);
  }
  return mesh;
}

PointCloud perturbed_copy(const PointCloud& cloud, const Perturbation& perturbation, uint64_t seed) {
  Eigen::Vector2d centroid = Eigen::Vector2d::Zero();
  for (const auto& p : cloud.points)
    centroid += p.head<2>().cast<double>() / static_cast<double>(cloud.size());
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  PointCloud copy;
  for (const Eigen::Vector3f& point : cloud.points) {
    Eigen::Vector3d p = point.cast<double>();
    if (perturbation.hole_m > 0 && (p.head<2>() - centroid).norm() < kMetre_mm * perturbation.hole_m)
      continue;
    p.z() += kMetre_mm * kShift_m;
    if (perturbation.noise_m > 0)
      for (double& coordinate : p) coordinate += kMetre_mm * perturbation.noise_m * normal(random);
    copy.points.push_back(p.cast<float>());
  }
  if (perturbation.sampling_factor > 1) {
    std::shuffle(copy.points.begin(), copy.points.end(), random);
    copy.points.resize(
        static_cast<size_t>(std::lround(static_cast<double>(copy.size()) / perturbation.sampling_factor)));
  }
  return copy;
}

}  // namespace gantry::bench
