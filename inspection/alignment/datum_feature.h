#pragma once

#include <vector>

#include "alignment/fit_frame.h"
#include "alignment/samples.h"
#include "gantry/inspection/datums.h"

namespace gantry::internal {

/// A datum as the CAD model has it.
struct CadFeature {
  Datum datum;
  Eigen::Vector3d origin;            ///< On the plane, on the axis, or the point itself.
  Eigen::Vector3d axis;              ///< Outward normal, or direction of the cylinder.
  double radius_mm = 0;              ///< Of a cylinder.
  double size_mm = 1;                ///< Half the extent of the region.
  std::vector<unsigned char> faces;  ///< Per triangle of the model: belongs to the feature.

  bool in_region(const Eigen::Vector3d& point) const;
};

/// Throws InputError when the model has no such feature there.
CadFeature cad_feature(const Datum& datum, const TriangleMesh& mesh, const std::string& set_name);

/// What a feature demands of a motion x, in the coordinates of a FitFrame: rows * x = -excess, direction
/// first, then position. Rows are scaled so that all are in mm at the frame's lever.
struct FeatureDemand {
  Eigen::Matrix<double, Eigen::Dynamic, 6> rows;
  Eigen::VectorXd excess;       ///< How far the cloud's feature is off the CAD's.
  Eigen::MatrixXd covariance;   ///< Of the excess.
  Eigen::Index directions = 0;  ///< Rows that are about direction; they come first.
  size_t points = 0;
  double rms_mm = 0;
};

/// Fits the feature to the points of the cloud that lie on its faces. Throws InputError when they are too
/// few.
FeatureDemand measure_feature(const CadFeature& feature, const std::vector<Pair>& pairs,
                              const std::vector<double>& weight, const FitFrame& frame,
                              const std::string& set_name);

}  // namespace gantry::internal
