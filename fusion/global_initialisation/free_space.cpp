#include "global_initialisation/free_space.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr double kCellSpacings = 1.5;
constexpr double kMarginSpacings = 2;
constexpr int kMaxCells = 2000;  // a side; what lies outside counts as background
constexpr float kNothing = std::numeric_limits<float>::infinity();

}  // namespace

FreeSpace::FreeSpace(const PointCloud& cloud, double spacing_mm) : margin_mm_(kMarginSpacings * spacing_mm) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const auto& p : cloud.points) centre += p.cast<double>() / static_cast<double>(cloud.size());
  image_from_cloud_ = Eigen::Quaterniond::FromTwoVectors(centre, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  cell_ = kCellSpacings * spacing_mm / centre.norm();
  Eigen::AlignedBox2d box;
  for (const auto& p : cloud.points) {
    const Eigen::Vector3d q = image_from_cloud_ * p.cast<double>();
    if (!(q.z() > 0))
      throw InputError(
          "sensor_at_origin: the cloud lies around the origin of its frame, where its sensor should be");
    box.extend(Eigen::Vector2d(q.head<2>() / q.z()));
  }
  low_ = box.min();
  width_ = std::min(kMaxCells, static_cast<int>(box.sizes().x() / cell_) + 1);
  height_ = std::min(kMaxCells, static_cast<int>(box.sizes().y() / cell_) + 1);
  nearest_.assign(static_cast<size_t>(width_) * height_, kNothing);
  for (const auto& p : cloud.points) {
    const Eigen::Vector3d q = image_from_cloud_ * p.cast<double>();
    const int c = static_cast<int>((q.x() / q.z() - low_.x()) / cell_);
    const int r = static_cast<int>((q.y() / q.z() - low_.y()) / cell_);
    for (int y = std::max(0, r - 1); y <= std::min(height_ - 1, r + 1); ++y)
      for (int x = std::max(0, c - 1); x <= std::min(width_ - 1, c + 1); ++x)
        nearest_[y * width_ + x] = std::min(nearest_[y * width_ + x], static_cast<float>(q.z()));
  }
}

FreeSpace::Seen FreeSpace::at(const Eigen::Vector3d& point) const {
  const Eigen::Vector3d q = image_from_cloud_ * point;
  if (!(q.z() > 0)) return Seen::kBackground;
  const double c = std::floor((q.x() / q.z() - low_.x()) / cell_),
               r = std::floor((q.y() / q.z() - low_.y()) / cell_);
  if (c < 0 || r < 0 || c >= width_ || r >= height_) return Seen::kBackground;
  const float nearest = nearest_[static_cast<size_t>(r) * width_ + static_cast<size_t>(c)];
  if (nearest == kNothing) return Seen::kBackground;
  return q.z() < nearest - margin_mm_ ? Seen::kInFront : Seen::kPossible;
}

}  // namespace gantry
