#include "surface_coverage.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <numeric>

#include "gantry/geometry/point_index.h"
#include "gantry/geometry/spatial_order.h"
#include "gantry/geometry/surface_samples.h"

namespace gantry::internal {
namespace {

constexpr double kAreaEachMm2 = 0.5;
constexpr double kLeastSamples = 20000, kMostSamples = 100000;
constexpr float kFacing = 0.5f;  // cosine

}  // namespace

double CoverageSamples::fraction() const {
  if (seen.empty()) return 0;
  return static_cast<double>(std::accumulate(seen.begin(), seen.end(), size_t{0})) /
         static_cast<double>(seen.size());
}

CoverageSamples sample_coverage(const SignedDistance& reference, const JudgedFeet& feet, double radius_mm) {
  const TriangleMesh& mesh = reference.mesh();
  const double area = mesh.surface_area();
  const auto count = static_cast<size_t>(std::clamp(area / kAreaEachMm2, kLeastSamples, kMostSamples));
  CoverageSamples samples;
  samples.surface = sample_surface(mesh, count, 1);
  samples.area_each_mm2 = area / static_cast<double>(count);
  samples.triangle.assign(count, 0);
  samples.seen.assign(count, 0);

  std::vector<Eigen::Vector3f> points, normals;
  for (size_t i = 0; i < feet.point.size(); ++i) {
    if (feet.triangle[i] < 0 || feet.beside[i]) continue;
    points.push_back(feet.point[i]);
    normals.push_back(mesh.normal(static_cast<size_t>(feet.triangle[i])));
  }
  const PointIndex index(points);
  for_each_run(samples.surface.points, [&](std::span<const uint32_t> run) {
    std::vector<PointIndex::Neighbour> near;
    int triangle = -1;
    for (const uint32_t i : run) {
      const Eigen::Vector3f &p = samples.surface.points[i], &normal = samples.surface.normals[i];
      if (const auto on = reference(p, normal, 0.99f, 1.0f, triangle))
        samples.triangle[i] = triangle = on->triangle;
      if (points.empty()) continue;
      index.within(p, static_cast<float>(radius_mm), near);
      samples.seen[i] = std::any_of(near.begin(), near.end(),
                                    [&](const auto& n) { return normals[n.index].dot(normal) > kFacing; });
    }
  });
  return samples;
}

}  // namespace gantry::internal
