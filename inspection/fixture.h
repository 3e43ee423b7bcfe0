#pragma once

#include <memory>
#include <vector>

#include "gantry/geometry/surface_index.h"
#include "gantry/inspection/inspection.h"

namespace gantry::internal {

/// What held the part, by its mesh, by a scan of it without a part, or both. Frame of the cloud.
class Fixture {
 public:
  /// Throws InputError when the mesh or the scan is empty.
  explicit Fixture(const InspectionOptions& options);
  ~Fixture();

  bool known() const;
  /// Each point's distance to the fixture, infinite where there is none within `reach_mm`.
  std::vector<float> distances(const std::vector<Eigen::Vector3f>& points, float reach_mm) const;

 private:
  struct Learned;
  std::unique_ptr<SurfaceIndex> mesh_;
  std::unique_ptr<Learned> learned_;
};

}  // namespace gantry::internal
