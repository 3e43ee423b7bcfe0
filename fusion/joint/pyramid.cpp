#include "joint/pyramid.h"

#include <algorithm>
#include <cmath>

namespace gantry::internal {

CoarseLevel make_level(const RangeSurface& s, int step) {
  CoarseLevel level;
  level.step = step;
  level.width = (s.width + step - 1) / step;
  level.height = (s.height + step - 1) / step;
  level.spacing_mm = s.spacing_mm * step;
  const size_t cells = static_cast<size_t>(level.width) * level.height;
  for (auto* v : {&level.x, &level.y, &level.z}) v->assign(cells, CoarseLevel::kNowhere);
  for (auto* v : {&level.nx, &level.ny, &level.nz}) v->assign(cells, 0.0f);
  std::vector<unsigned char> seen(cells, 0);
  const float middle = 0.5f * static_cast<float>(step - 1);
  for (int row = 0; row < level.height; ++row) {
    for (int column = 0; column < level.width; ++column) {
      const size_t cell = static_cast<size_t>(row) * level.width + column;
      float nearest = 1e9f;
      int at_column = -1, at_row = -1;
      for (int r = row * step; r < std::min(s.height, (row + 1) * step); ++r) {
        for (int c = column * step; c < std::min(s.width, (column + 1) * step); ++c) {
          const size_t i = s.index(c, r);
          if (s.flags[i] & RangeSurface::kSeen) seen[cell] = 1;
          if (s.w[i] == 0 || (s.flags[i] & RangeSurface::kRim)) continue;
          const float dc = static_cast<float>(c - column * step) - middle,
                      dr = static_cast<float>(r - row * step) - middle;
          const float distance = dc * dc + dr * dr;
          if (distance >= nearest) continue;
          nearest = distance;
          at_column = c;
          at_row = r;
        }
      }
      if (at_column < 0) continue;
      const Eigen::Vector3d p = s.point(at_column, at_row);
      const Eigen::Vector3f n = unpack_normal(s.normals[s.index(at_column, at_row)]);
      level.x[cell] = static_cast<float>(p.x());
      level.y[cell] = static_cast<float>(p.y());
      level.z[cell] = static_cast<float>(p.z());
      level.nx[cell] = n.x();
      level.ny[cell] = n.y();
      level.nz[cell] = n.z();
      level.filled.push_back(static_cast<int>(cell));
    }
  }
  level.empty.assign(cells, 1);
  for (int row = 0; row < level.height; ++row)
    for (int column = 0; column < level.width; ++column)
      if (seen[static_cast<size_t>(row) * level.width + column])
        for (int r = std::max(0, row - 1); r <= std::min(level.height - 1, row + 1); ++r)
          for (int c = std::max(0, column - 1); c <= std::min(level.width - 1, column + 1); ++c)
            level.empty[static_cast<size_t>(r) * level.width + c] = 0;
  level.border.assign(cells, 0);
  for (const int i : level.filled) {
    const int column = i % level.width, row = i / level.width;
    for (int r = row - 1; r <= row + 1; ++r)
      for (int c = column - 1; c <= column + 1; ++c)
        if (r < 0 || c < 0 || r >= level.height || c >= level.width ||
            level.z[static_cast<size_t>(r) * level.width + c] == CoarseLevel::kNowhere)
          level.border[i] = 1;
  }
  return level;
}

}  // namespace gantry::internal
