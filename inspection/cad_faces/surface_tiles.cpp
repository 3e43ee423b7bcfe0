#include "cad_faces/surface_tiles.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>

#include "gantry/geometry/spatial_order.h"

namespace gantry::internal {
namespace {

constexpr size_t kTiles = 72;
constexpr size_t kFitSamples = 10000;  // of the surface, for Lloyd's algorithm
constexpr int kRounds = 60, kSettling = 12;
constexpr double kTooSmall = 0.5, kTooLarge = 1.5;  // times the mean

}  // namespace

SurfaceTiles::SurfaceTiles(const CoverageSamples& samples) {
  const std::vector<Eigen::Vector3f>&points = samples.surface.points, &normals = samples.surface.normals;
  const size_t stride = std::max<size_t>(1, points.size() / kFitSamples);
  std::vector<size_t> fit;
  for (size_t i = 0; i < points.size(); i += stride) fit.push_back(i);
  if (fit.empty()) return;
  const double area = samples.area_each_mm2 * static_cast<double>(points.size());
  normal_weight_ = static_cast<float>(area / kTiles);

  // Start: each next centre is the sample furthest from those before it.
  std::vector<float> nearest(fit.size(), std::numeric_limits<float>::max());
  for (size_t next = 0; tiles_.size() < std::min(kTiles, fit.size());) {
    Tile tile;
    tile.centre = points[fit[next]];
    tile.normal = normals[fit[next]];
    tiles_.push_back(tile);
    for (size_t k = 0; k < fit.size(); ++k)
      nearest[k] = std::min(nearest[k], distance(tile, points[fit[k]], normals[fit[k]]));
    next = static_cast<size_t>(std::max_element(nearest.begin(), nearest.end()) - nearest.begin());
  }
  std::vector<size_t> own(fit.size());
  for (int round = 0; round < kRounds; ++round) {
    tbb::parallel_for(size_t{0}, fit.size(),
                      [&](size_t k) { own[k] = tile_of(points[fit[k]], normals[fit[k]]); });
    std::vector<Eigen::Vector3d> place(tiles_.size(), Eigen::Vector3d::Zero()), facing = place;
    std::vector<double> count(tiles_.size(), 0);
    for (size_t k = 0; k < fit.size(); ++k) {
      place[own[k]] += points[fit[k]].cast<double>();
      facing[own[k]] += normals[fit[k]].cast<double>();
      ++count[own[k]];
    }
    for (size_t t = 0; t < tiles_.size(); ++t) {
      if (count[t] == 0) continue;
      tiles_[t].centre = (place[t] / count[t]).cast<float>();
      tiles_[t].normal = (facing[t] / count[t]).cast<float>();
    }
    // Tiles of one area: the smallest moves into the largest, to its sample furthest from the centre.
    const auto [least, most] = std::minmax_element(count.begin(), count.end());
    const double mean = static_cast<double>(fit.size()) / static_cast<double>(tiles_.size());
    if (round >= kRounds - kSettling || *least > kTooSmall * mean || *most < kTooLarge * mean) continue;
    const auto from = static_cast<size_t>(least - count.begin()),
               to = static_cast<size_t>(most - count.begin());
    float furthest = -1;
    for (size_t k = 0; k < fit.size(); ++k) {
      if (own[k] != to) continue;
      const float d = distance(tiles_[to], points[fit[k]], normals[fit[k]]);
      if (d <= furthest) continue;
      furthest = d;
      tiles_[from].centre = points[fit[k]];
      tiles_[from].normal = normals[fit[k]];
    }
  }
  std::vector<Eigen::Vector3f> centres;
  for (const Tile& tile : tiles_) centres.push_back(tile.centre);
  std::vector<Tile> sorted;
  for (const uint32_t t : morton_order(centres)) sorted.push_back(tiles_[t]);
  tiles_ = std::move(sorted);

  std::vector<size_t> all(points.size());
  tbb::parallel_for(size_t{0}, points.size(), [&](size_t i) { all[i] = tile_of(points[i], normals[i]); });
  std::vector<float> middle(tiles_.size(), std::numeric_limits<float>::max());
  for (size_t i = 0; i < points.size(); ++i) {
    Tile& tile = tiles_[all[i]];
    ++tile.samples;
    tile.seen += samples.seen[i];
    tile.area_mm2 += samples.area_each_mm2;
    if (const float d = distance(tile, points[i], normals[i]); d < middle[all[i]]) {
      middle[all[i]] = d;
      tile.middle = i;
    }
  }
}

size_t SurfaceTiles::tile_of(const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const {
  size_t best = 0;
  float least = std::numeric_limits<float>::max();
  for (size_t t = 0; t < tiles_.size(); ++t)
    if (const float d = distance(tiles_[t], point, normal); d < least) {
      least = d;
      best = t;
    }
  return best;
}

}  // namespace gantry::internal
