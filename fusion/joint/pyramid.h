#pragma once

#include <vector>

#include "gantry/fusion/range_surface.h"

namespace gantry::internal {

/// A range image with fewer pixels: of each square of `step` pixels the usable one nearest to its middle.
/// In the grid frame. Arrays of width * height; cells without data have x = y = z = kNowhere.
struct CoarseLevel {
  static constexpr float kNowhere = 1e18f;
  int step = 0, width = 0, height = 0;
  std::vector<float> x, y, z, nx, ny, nz;
  std::vector<unsigned char> empty;   ///< 1: nothing was measured in this cell nor in any beside it.
  std::vector<unsigned char> border;  ///< 1: a cell beside this one holds no point.
  std::vector<int> filled;            ///< Cells that hold a point, in order.
  double spacing_mm = 0;              ///< Distance of neighbouring cells' points, frontal.

  Eigen::Vector3f point(int i) const { return {x[i], y[i], z[i]}; }
  Eigen::Vector3f normal(int i) const { return {nx[i], ny[i], nz[i]}; }
};

CoarseLevel make_level(const RangeSurface& surface, int step);

}  // namespace gantry::internal
