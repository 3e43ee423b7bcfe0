#pragma once

#include <Eigen/Core>
#include <vector>

#include "surface_coverage.h"

namespace gantry::internal {

/// The CAD surface cut into tiles of about equal area: centroidal Voronoi cells (Lloyd's algorithm, small
/// ones moved into large ones) in position and normal, the normal weighted by the size of a tile, so that the
/// two sides of a sheet never share one and tiles tend to end at edges. The same for every part held against
/// one CAD model.
class SurfaceTiles {
 public:
  struct Tile {
    Eigen::Vector3f centre, normal;  ///< Means; the normal is not unit: shorter where the tile is bent.
    double area_mm2 = 0;
    size_t samples = 0, seen = 0;
    size_t middle = 0;  ///< The sample closest to the centre.
  };

  /// About 72 tiles; `samples` of the surface as sample_coverage() gives them.
  explicit SurfaceTiles(const CoverageSamples& samples);

  const std::vector<Tile>& tiles() const { return tiles_; }  ///< Neighbours in number are so in space.
  size_t tile_of(const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const;

 private:
  float distance(const Tile& tile, const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const {
    return (tile.centre - point).squaredNorm() + normal_weight_ * (tile.normal - normal).squaredNorm();
  }

  float normal_weight_ = 0;
  std::vector<Tile> tiles_;
};

}  // namespace gantry::internal
