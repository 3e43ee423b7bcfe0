#pragma once

#include <Eigen/Core>

#include "gantry/geometry/point_cloud.h"

namespace gantry {

/// Fast Point Feature Histograms (Rusu, Blodow, Beetz, ICRA 2009), one column of 33 numbers a point,
/// computed by PCL: how the normals turn around the point, seen from its own normal, blind to the pose.
/// Three histograms of 11 bins; each sums to 1 here, or is zero for a point without neighbours.
Eigen::MatrixXf compute_fpfh(const PointCloud& cloud, double radius_mm);

}  // namespace gantry
