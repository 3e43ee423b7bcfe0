#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/scan.h"

namespace gantry {

struct PreprocessOptions {
  /// Points outside this box are dropped; in the part frame, by the scan's initial pose.
  std::optional<Eigen::AlignedBox3d> crop_part_mm;
  int normal_window_px = 3;  ///< Half width of the window in which an organised scan's normals are fitted.
  size_t normal_neighbours = 20;  ///< Neighbours for the normals of an unorganised scan.
  int edge_margin_px = 2;         ///< Pixels this close to a depth step are dropped: they may be mixed.
  double min_window_fill =
      0.6;  ///< A pixel whose window holds fewer measurements (fraction) lies at the rim.
};

/// One scan made ready for registration: the surface that the sensor saw, in the `sensor` frame, with
/// normals towards the sensor and a standard uncertainty for each point.
struct ScanSurface {
  std::string name;
  UncertainPose part_from_sensor;  ///< As tagged.
  PointCloud cloud;                ///< With normals and sigma_mm.
  std::vector<unsigned char> rim;  ///< 1: at the border of the data; nothing may be matched to it.
  double spacing_mm = 0;           ///< Median distance of neighbouring points.
  double noise_mm = 0;             ///< Median standard uncertainty of the points.
  size_t measured = 0;             ///< Valid points before preprocessing.
  size_t dropped_crop = 0;         ///< Outside the part's volume.
  size_t dropped_edges = 0;        ///< At depth steps, outliers, or without enough neighbours.
};

/// Organised scans are worked on the pixel grid: points at depth steps dropped with a margin (mixed
/// pixels), normals by principal components of a window, outliers by their distance from the window's
/// plane, the noise level from the residuals of those planes. Unorganised scans take the same steps
/// on nearest neighbours. Throws InputError when fewer than 100 points remain.
ScanSurface preprocess(const TaggedScan& scan, const PreprocessOptions& options);

}  // namespace gantry
