#pragma once

#include <cstdint>
#include <vector>

#include "gantry/geometry/signed_distance.h"

namespace gantry::internal {

/// The closest piece of a model for each cell of a grid around it: distances to within about half a cell, at
/// the price of one look-up. For coarse tests of very many poses.
class DistanceField {
 public:
  struct Foot {
    Eigen::Vector3f point, normal;
  };

  /// `cells` along the longest side; the grid reaches past the model by a fifth of its diagonal.
  DistanceField(const SignedDistance& model, int cells);

  /// The piece closest to the cell that the point lies in; of a point outside the grid to the nearest cell.
  const Foot& foot(const Eigen::Vector3f& point) const {
    const Eigen::Array3i cell = ((point - low_) / cell_mm_).array().cast<int>().max(0).min(count_ - 1);
    return feet_[static_cast<size_t>((cell.z() * count_.y() + cell.y()) * count_.x() + cell.x())];
  }
  double cell_mm() const { return cell_mm_; }

 private:
  Eigen::Vector3f low_;
  float cell_mm_ = 1;
  Eigen::Array3i count_;
  std::vector<Foot> feet_;
};

}  // namespace gantry::internal
