#pragma once

#include <Eigen/Core>
#include <limits>
#include <string>

namespace gantry {

/// What was measured on one piece of the CAD surface: a face (cad_faces.h) or a tile of about equal size.
/// Deviations in mm; NaN where no point was judged. Positions in the frame of the CAD model.
struct SurfaceStatistics {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  std::string name;   ///< "plane 3", "region 17": the same for every part that is held against one CAD model.
  std::string words;  ///< "hole of 8.0 mm along z at x 20.0, y 10.0"
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< Mean, unit; zero where normals cancel.
  double area_mm2 = 0;
  double seen = 0;    ///< Fraction of the area.
  size_t points = 0;  ///< Judged.
  double mean_mm = kNone, sigma_mm = kNone, p05_mm = kNone, p95_mm = kNone, min_mm = kNone, max_mm = kNone;
  /// Standard uncertainty of mean_mm: the mean of the points'. Neighbours share most of it (registration,
  /// alignment), so that no more is claimed for a mean than for what it is the mean of.
  double uncertainty_mm = kNone;
};

}  // namespace gantry
