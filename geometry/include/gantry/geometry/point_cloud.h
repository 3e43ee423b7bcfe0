#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "gantry/geometry/cloud_sources.h"

namespace gantry {

/// Points of a surface without a grid. Coordinates in mm in the frame that the owner names (mostly
/// `part`). `normals` (unit, pointing out of the material) and `sigma_mm` (standard uncertainty along
/// the normal) are either empty or as long as `points`.
struct PointCloud {
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> sigma_mm;
  /// Which scans the points come from; null when that is not known. Holds for this cloud's points and their
  /// order only.
  std::shared_ptr<const CloudSources> sources;

  size_t size() const { return points.size(); }
  bool has_normals() const { return !points.empty() && normals.size() == points.size(); }
  bool has_sigma() const { return !points.empty() && sigma_mm.size() == points.size(); }
};

/// These points of a cloud, with all that is known of them.
PointCloud select(const PointCloud& cloud, std::span<const uint32_t> which);

}  // namespace gantry
