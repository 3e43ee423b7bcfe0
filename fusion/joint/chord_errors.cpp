#include "joint/chord_errors.h"

#include <cmath>

#include "joint/projection.h"

namespace gantry::internal {
namespace {

constexpr int kStride = 4;

/// Slopes of w along the row and along the column, per pixel, of the plane through a pixel.
class Slopes {
 public:
  explicit Slopes(const RangeSurface& s) : s_(s), to_ray_(s.rays.ray_of_pixel.leftCols<3>().cast<float>()) {}

  bool known(int column, int row) const {
    return column >= 0 && row >= 0 && column < s_.width && row < s_.height &&
           s_.w[s_.index(column, row)] != 0;
  }
  Eigen::Vector2f at(int column, int row) const {
    const size_t i = s_.index(column, row);
    const Eigen::Vector3f n = unpack_normal(s_.normals[i]);
    Eigen::Vector2f ray = to_ray_ * Eigen::Vector3f(1, static_cast<float>(column), static_cast<float>(row));
    Eigen::Matrix2f ray_by_pixel = to_ray_.rightCols<2>();
    if (s_.rays.distorted) {
      const Eigen::Vector2d here = s_.rays.ray(column, row);
      ray = here.cast<float>();
      ray_by_pixel.col(0) = (s_.rays.ray(column + 1, row) - here).cast<float>();
      ray_by_pixel.col(1) = (s_.rays.ray(column, row + 1) - here).cast<float>();
    }
    // 1 = (w - slope . ray) z + slope . (x, y), or z = w + slope . (x, y)
    const Eigen::Vector2f per_ray = s_.rays.central
                                        ? Eigen::Vector2f(n.head<2>() * (s_.w[i] / n.dot(ray.homogeneous())))
                                        : Eigen::Vector2f(-n.head<2>() / n.z());
    return ray_by_pixel.transpose() * per_ray;
  }

 private:
  const RangeSurface& s_;
  Eigen::Matrix<float, 2, 3> to_ray_;
};

}  // namespace

Vector6d chord_errors(const RangeSurface& target, const RangeSurface& source, const Pose& target_from_source,
                      const Pose& part_from_target, const Eigen::Vector3d& centre, const MatchGates& gates) {
  const Projector projector(target, source, target_from_source);
  const Slopes slopes(target);
  const int apart = target.normal_window_px;
  const auto cosine = static_cast<float>(std::cos(gates.max_angle_rad)),
             reach = static_cast<float>(gates.reach_mm);
  const double scale_squared = gates.scale_mm * gates.scale_mm;
  PairSum sum;
  projector.block<true>(0, source.width, 0, source.height, kStride, [&](const Projected& at) {
    Surface surface;
    if (!projector.measured(at, surface)) return;
    const Eigen::Vector3f m = unpack_normal(target.normals[surface.nearest]);
    if (m.dot(at.n) < cosine) return;
    const Eigen::Vector3f n = (m + at.n).normalized();
    const float d = projector.distance(at, surface, n);
    if (std::abs(d) > reach) return;
    const int column = static_cast<int>(surface.nearest % static_cast<size_t>(target.width)),
              row = static_cast<int>(surface.nearest / static_cast<size_t>(target.width));
    const Eigen::Vector2f here = slopes.at(column, row);
    Eigen::Vector2f bend = Eigen::Vector2f::Zero();
    for (int axis = 0; axis < 2; ++axis) {
      int steps = 0;
      for (const int side : {-apart, apart}) {
        const int c = column + (axis == 0 ? side : 0), r = row + (axis == 1 ? side : 0);
        if (!slopes.known(c, r)) continue;
        const float change = slopes.at(c, r)[axis] - here[axis];
        bend[axis] += side < 0 ? -change : change;
        steps += apart;
      }
      if (steps > 0) bend[axis] /= static_cast<float>(steps);
    }
    const float across = at.column_part * (1 - at.column_part), down = at.row_part * (1 - at.row_part);
    const float inside_w = 0.5f * (bend[0] * across + bend[1] * down);
    const float inside_mm = target.rays.central ? n.dot(at.p) / surface.w * inside_w : -n.z() * inside_w;

    const double loss = scale_squared / (scale_squared + static_cast<double>(d) * d), weight = loss * loss;
    sum.add(part_from_target * at.p.cast<double>() - centre, part_from_target.linear() * n.cast<double>(),
            inside_mm, weight, gates.normal_variance);
  });
  if (sum.matches == 0) return Vector6d::Zero();
  sum.take_out_tilts();
  return kStride * kStride * sum.gradient;
}

}  // namespace gantry::internal
