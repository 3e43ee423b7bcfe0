#include "cad_faces/patch_statistics.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "cad_faces/surface_tiles.h"

namespace gantry::internal {
namespace {

/// Adds what the points of each patch measured. `patch_of` point; -1: none.
void add_deviations(std::vector<SurfaceStatistics>& patches, const InspectionResult& result,
                    const std::vector<int>& patch_of) {
  std::vector<std::vector<float>> deviations(patches.size());
  std::vector<double> uncertainty(patches.size(), 0);
  for (size_t i = 0; i < patch_of.size(); ++i) {
    if (patch_of[i] < 0) continue;
    deviations[patch_of[i]].push_back(result.deviation_mm[i]);
    uncertainty[patch_of[i]] += result.uncertainty_mm[i];
  }
  tbb::parallel_for(size_t{0}, patches.size(), [&](size_t p) {
    std::vector<float>& values = deviations[p];
    SurfaceStatistics& s = patches[p];
    s.points = values.size();
    if (values.empty()) return;
    std::sort(values.begin(), values.end());
    const double n = static_cast<double>(values.size());
    double sum = 0, squares = 0;
    for (const float v : values) sum += v;
    s.mean_mm = sum / n;
    for (const float v : values) squares += (v - s.mean_mm) * (v - s.mean_mm);
    s.sigma_mm = std::sqrt(squares / n);
    s.min_mm = values.front();
    s.max_mm = values.back();
    s.p05_mm = values[static_cast<size_t>(0.05 * (n - 1))];
    s.p95_mm = values[static_cast<size_t>(0.95 * (n - 1))];
    s.uncertainty_mm = uncertainty[p] / n;
  });
}

}  // namespace

void measure_surface(InspectionResult& result, const TriangleMesh& mesh, const CadFaces& cad,
                     const JudgedFeet& feet, const CoverageSamples& samples) {
  const size_t n = feet.triangle.size();
  std::vector<int> face_of(n, -1), tile_of(n, -1);
  const SurfaceTiles tiles(samples);
  tbb::parallel_for(size_t{0}, n, [&](size_t i) {
    if (feet.triangle[i] < 0) return;
    face_of[i] = cad.face_of_triangle[feet.triangle[i]];
    tile_of[i] =
        static_cast<int>(tiles.tile_of(feet.point[i], mesh.normal(static_cast<size_t>(feet.triangle[i]))));
  });

  std::vector<size_t> sampled(cad.faces.size(), 0), seen(cad.faces.size(), 0);
  for (size_t i = 0; i < samples.seen.size(); ++i) {
    const int face = cad.face_of_triangle[samples.triangle[i]];
    ++sampled[face];
    seen[face] += samples.seen[i];
  }
  result.faces.clear();
  for (size_t f = 0; f < cad.faces.size(); ++f) {
    const CadFace& face = cad.faces[f];
    SurfaceStatistics s;
    s.name = face.name;
    s.words = face.words;
    s.centre_mm = face.centre_mm;
    s.normal = face.normal;
    s.area_mm2 = face.area_mm2;
    s.seen = sampled[f] > 0 ? static_cast<double>(seen[f]) / static_cast<double>(sampled[f]) : 0;
    result.faces.push_back(s);
  }
  add_deviations(result.faces, result, face_of);

  result.regions.clear();
  for (const SurfaceTiles::Tile& tile : tiles.tiles()) {
    SurfaceStatistics s;
    s.name = "region " + std::to_string(result.regions.size() + 1);
    const Eigen::Vector3f& middle = samples.surface.points[tile.middle];
    char place[80];
    std::snprintf(place, sizeof place, " around (%.1f, %.1f, %.1f)", middle.x(), middle.y(), middle.z());
    s.words =
        cad.faces.at(static_cast<size_t>(cad.face_of_triangle[samples.triangle[tile.middle]])).name + place;
    s.centre_mm = middle.cast<double>();
    s.normal = tile.normal.norm() > 1e-3f ? Eigen::Vector3d(tile.normal.normalized().cast<double>())
                                          : Eigen::Vector3d(0, 0, 0);
    s.area_mm2 = tile.area_mm2;
    s.seen = tile.samples > 0 ? static_cast<double>(tile.seen) / static_cast<double>(tile.samples) : 0;
    result.regions.push_back(s);
  }
  add_deviations(result.regions, result, tile_of);
}

}  // namespace gantry::internal
