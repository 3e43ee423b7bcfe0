#include "surface_coverage.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <random>

#include "gantry/geometry/point_index.h"

namespace gantry::internal {

double surface_coverage(const TriangleMesh& mesh, const PointCloud& feet, double radius_mm) {
  if (feet.points.empty()) return 0;
  constexpr size_t kSamples = 20000;
  std::vector<double> cumulative;
  double total = 0;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) cumulative.push_back(total += mesh.area(t));
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform;
  struct Sample {
    Eigen::Vector3f point, normal;
  };
  std::vector<Sample> samples;
  for (size_t i = 0; i < kSamples; ++i) {
    const auto t =
        static_cast<size_t>(std::lower_bound(cumulative.begin(), cumulative.end(),
                                             (static_cast<double>(i) + uniform(random)) / kSamples * total) -
                            cumulative.begin());
    if (t >= mesh.triangles.size()) continue;
    const double r = std::sqrt(uniform(random)), s = uniform(random);
    const Eigen::Vector3i& tri = mesh.triangles[t];
    samples.push_back({static_cast<float>(1 - r) * mesh.vertices[tri[0]] +
                           static_cast<float>(r * (1 - s)) * mesh.vertices[tri[1]] +
                           static_cast<float>(r * s) * mesh.vertices[tri[2]],
                       mesh.normal(t)});
  }
  const PointIndex index(feet.points);
  std::atomic<size_t> seen{0};
  tbb::parallel_for(size_t{0}, samples.size(), [&](size_t i) {
    thread_local std::vector<PointIndex::Neighbour> near;
    index.within(samples[i].point, static_cast<float>(radius_mm), near);
    seen += std::any_of(near.begin(), near.end(), [&](const auto& n) {
      return !feet.has_normals() || feet.normals[n.index].dot(samples[i].normal) > 0.5f;
    });
  });
  return static_cast<double>(seen) / static_cast<double>(samples.size());
}

}  // namespace gantry::internal
