#pragma once

#include <memory>

#include "method.h"

namespace gantry::bench {

/// Open3D's "multiway registration" with the settings of its tutorial, brought to mm: voxel averages, normals
/// from nearest neighbours, all pairs in two stages, neighbours in order as odometry and the others as
/// uncertain loop closures, global optimisation by Levenberg-Marquardt with its defaults.
struct Open3dSettings {
  double voxel_mm = 1;
  double coarse_mm = 15;  ///< The tutorial: 15 voxels, ...
  double fine_mm = 1.5;   ///< ... then 1.5 voxels.
  bool generalized_icp = true;
};

std::unique_ptr<Method> make_open3d_multiway(const Open3dSettings& settings);

/// Its threads are OpenMP's; 0: one for each core.
void set_open3d_threads(int threads);

}  // namespace gantry::bench
