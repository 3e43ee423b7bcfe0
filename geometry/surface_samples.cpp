#include "gantry/geometry/surface_samples.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

/// In [0, 1), of 53 bits: std::uniform_real_distribution gives other numbers with other standard libraries.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}

}  // namespace

PointCloud sample_surface(const TriangleMesh& mesh, size_t count, uint64_t seed) {
  std::vector<double> area_up_to;  // the sum over a triangle and all before it
  double area = 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) area_up_to.push_back(area += mesh.area(t));
  if (!(area > 0)) throw InputError("a mesh without area cannot be sampled");
  std::mt19937_64 random(seed);
  PointCloud cloud;
  cloud.points.reserve(count);
  cloud.normals.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    const auto found = std::upper_bound(area_up_to.begin(), area_up_to.end(), uniform(random) * area);
    const auto t = static_cast<size_t>(std::min(found, area_up_to.end() - 1) - area_up_to.begin());
    // The root spreads evenly what would gather at corner 0.
    const double s = std::sqrt(uniform(random)), u = uniform(random);
    const auto corner = [&](int k) { return mesh.vertices[mesh.triangles[t][k]].cast<double>(); };
    cloud.points.push_back(((1 - s) * corner(0) + s * (1 - u) * corner(1) + s * u * corner(2)).cast<float>());
    cloud.normals.push_back(mesh.normal(t));
  }
  return cloud;
}

}  // namespace gantry
