#include "report/coverage_sides.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <vector>

#include "gantry/geometry/point_index.h"
#include "gantry/geometry/surface_samples.h"

namespace gantry::report {

std::array<SideCoverage, 6> coverage_sides(const TriangleMesh& cad, const MeasuredSurface& measured) {
  constexpr size_t kSamples = 20000;
  constexpr float kRadiusMm = 1.0f;
  std::array<SideCoverage, 6> sides;
  for (size_t i = 0; i < sides.size(); ++i) sides[i].towards = {i % 2 ? '-' : '+', "xyz"[i / 2]};
  for (size_t t = 0; t < cad.triangles.size(); ++t)
    sides[dominant_axis(cad.normal(t))].area_mm2 += cad.area(t);

  const PointCloud samples = sample_surface(cad, kSamples, 1);
  std::vector<Eigen::Vector3f> points;
  points.reserve(measured.on_cad.size());
  for (const Surfel& s : measured.on_cad) points.push_back(s.position);
  std::vector<char> seen(kSamples, 0);
  if (!points.empty()) {
    const PointIndex index(points);
    tbb::parallel_for(size_t{0}, kSamples, [&](size_t i) {
      thread_local std::vector<PointIndex::Neighbour> near;
      index.within(samples.points[i], kRadiusMm, near);
      seen[i] = std::any_of(near.begin(), near.end(), [&](const auto& n) {
        return measured.on_cad[n.index].normal.dot(samples.normals[i]) > 0.5f;
      });
    });
  }
  std::array<size_t, 6> count{}, found{};
  for (size_t i = 0; i < kSamples; ++i) {
    const int side = dominant_axis(samples.normals[i]);
    ++count[side];
    found[side] += seen[i];
  }
  for (size_t i = 0; i < sides.size(); ++i)
    if (count[i] > 0) sides[i].seen = static_cast<double>(found[i]) / static_cast<double>(count[i]);
  return sides;
}

}  // namespace gantry::report
