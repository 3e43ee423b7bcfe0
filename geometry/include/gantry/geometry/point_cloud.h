#pragma once

#include <Eigen/Core>
#include <vector>

namespace gantry {

/// Points of a surface without a grid. Coordinates in mm in the frame that the owner names (mostly
/// `part`). `normals` (unit, pointing out of the material) and `sigma_mm` (standard uncertainty along
/// the normal) are either empty or as long as `points`.
struct PointCloud {
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> sigma_mm;

  size_t size() const { return points.size(); }
  bool has_normals() const { return !points.empty() && normals.size() == points.size(); }
  bool has_sigma() const { return !points.empty() && sigma_mm.size() == points.size(); }
};

}  // namespace gantry
