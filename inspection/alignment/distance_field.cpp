#include "alignment/distance_field.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>

namespace gantry::internal {

DistanceField::DistanceField(const SignedDistance& model, int cells) {
  const Eigen::AlignedBox3f box = model.mesh().bounds();
  const float margin = 0.2f * box.diagonal().norm();
  low_ = box.min().array() - margin;
  const Eigen::Vector3f size = box.sizes().array() + 2 * margin;
  cell_mm_ = size.maxCoeff() / static_cast<float>(cells);
  count_ = (size.array() / cell_mm_).ceil().cast<int>().max(1);
  feet_.resize(static_cast<size_t>(count_.prod()));
  tbb::parallel_for(0, count_.z() * count_.y(), [&](int row) {
    SurfaceIndex::Neighbourhood near;
    for (int x = 0; x < count_.x(); ++x) {
      const Eigen::Vector3f centre =
          low_ + cell_mm_ * Eigen::Vector3f(static_cast<float>(x) + 0.5f,
                                            static_cast<float>(row % count_.y()) + 0.5f,
                                            static_cast<float>(row / count_.y()) + 0.5f);
      const auto value = model(centre, std::numeric_limits<float>::infinity(), near);
      feet_[static_cast<size_t>(row) * static_cast<size_t>(count_.x()) + static_cast<size_t>(x)] = {
          value->closest, model.mesh().normal(static_cast<size_t>(value->triangle))};
    }
  });
}

}  // namespace gantry::internal
