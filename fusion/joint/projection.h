#pragma once

#include <algorithm>
#include <cmath>

#include "gantry/fusion/range_surface.h"

namespace gantry::internal {

/// A pixel of the source as it falls into the target's range image, in the target's grid frame.
struct Projected {
  Eigen::Vector3f p, n;                 ///< The source's point and normal.
  float p_w = 0;                        ///< Its depth coordinate there.
  int column = 0, row = 0;              ///< The pixel up and left of where it falls.
  float column_part = 0, row_part = 0;  ///< How far beyond that pixel, 0..1.
};

/// What the target has measured where a source pixel falls: its raw depth, interpolated bilinearly between
/// the four measurements around (smoothed depth would be biased on curved surfaces).
struct Surface {
  float w = 0;
  size_t nearest = 0;  ///< Index of the nearest pixel.
};

/// Walks over every stride-th pixel of a block of the source and projects it into the target.
class Projector {
 public:
  Projector(const RangeSurface& target, const RangeSurface& source, const Pose& target_from_source)
      : target_(target),
        source_(source),
        rotation_(target_from_source.linear().cast<float>()),
        shift_(target_from_source.translation().cast<float>()),
        to_pixel_(target.rays.pixel_of_ray.leftCols<3>().cast<float>()),
        to_ray_(source.rays.ray_of_pixel.leftCols<3>().cast<float>()),
        last_column_(static_cast<float>(target.width - 1)),
        last_row_(static_cast<float>(target.height - 1)) {}

  /// Calls visit(const Projected&) for each usable pixel of the block that falls into the target's image;
  /// with `facing_only` only for those whose surface faces the target's sensor.
  template <bool facing_only, typename Visit>
  void block(int first_column, int last_column, int first_row, int last_row, int stride,
             Visit&& visit) const {
    const bool central = target_.rays.central;
    for (int row = (first_row + stride - 1) / stride * stride; row < last_row; row += stride) {
      for (int column = (first_column + stride - 1) / stride * stride; column < last_column;
           column += stride) {
        const size_t i = source_.index(column, row);
        const float w = source_.w[i];
        if (w == 0) continue;
        Projected at;
        at.p = rotation_ * source_point(column, row, w) + shift_;
        at.n = rotation_ * unpack_normal(source_.normals[i]);
        float u = at.p.x(), v = at.p.y();
        if (central) {
          if (at.p.z() <= 1) continue;
          if (facing_only && at.n.dot(at.p) >= 0) continue;
          at.p_w = 1 / at.p.z();
          u *= at.p_w;
          v *= at.p_w;
        } else {
          if (facing_only && at.n.z() >= 0) continue;
          at.p_w = at.p.z();
        }
        Eigen::Vector2f pixel = to_pixel_ * Eigen::Vector3f(1, u, v);
        if (target_.rays.distorted) pixel = target_.rays.pixel({u, v}).cast<float>();
        // NaN fails this too.
        if (!(pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < last_column_ && pixel.y() < last_row_))
          continue;
        at.column = static_cast<int>(pixel.x());
        at.row = static_cast<int>(pixel.y());
        at.column_part = pixel.x() - static_cast<float>(at.column);
        at.row_part = pixel.y() - static_cast<float>(at.row);
        visit(at);
      }
    }
  }

  /// Whether the target measured all around the place; fills `out`.
  bool measured(const Projected& at, Surface& out) const {
    const size_t j = target_.index(at.column, at.row);
    const float w00 = target_.w[j], w01 = target_.w[j + 1], w10 = target_.w[j + target_.width],
                w11 = target_.w[j + target_.width + 1];
    if (w00 == 0 || w01 == 0 || w10 == 0 || w11 == 0) return false;
    out.w = (1 - at.row_part) * ((1 - at.column_part) * w00 + at.column_part * w01) +
            at.row_part * ((1 - at.column_part) * w10 + at.column_part * w11);
    out.nearest =
        j + (at.column_part > 0.5f ? 1 : 0) + (at.row_part > 0.5f ? static_cast<size_t>(target_.width) : 0);
    return true;
  }

  /// n . (p - q), q being where the target's ray through p meets its surface.
  float distance(const Projected& at, const Surface& surface, const Eigen::Vector3f& n) const {
    return target_.rays.central ? n.dot(at.p) * (1 - at.p_w / surface.w) : n.z() * (at.p_w - surface.w);
  }

 private:
  Eigen::Vector3f source_point(int column, int row, float w) const {
    Eigen::Vector2f ray = to_ray_ * Eigen::Vector3f(1, static_cast<float>(column), static_cast<float>(row));
    if (source_.rays.distorted) ray = source_.rays.ray(column, row).cast<float>();
    return source_.rays.central ? Eigen::Vector3f(ray.x() / w, ray.y() / w, 1 / w)
                                : Eigen::Vector3f(ray.x(), ray.y(), w);
  }

  const RangeSurface& target_;
  const RangeSurface& source_;
  Eigen::Matrix3f rotation_;
  Eigen::Vector3f shift_;
  Eigen::Matrix<float, 2, 3> to_pixel_, to_ray_;
  float last_column_, last_row_;
};

}  // namespace gantry::internal
