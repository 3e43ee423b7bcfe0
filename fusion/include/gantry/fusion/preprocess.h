#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gantry/fusion/range_surface.h"
#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/scan.h"

namespace gantry {

struct PreprocessOptions {
  /// Points outside this box are dropped; in the part frame, by the scan's tagged pose: leave it a margin as
  /// wide as that pose is uncertain.
  std::optional<Eigen::AlignedBox3d> crop_part_mm;
  /// Half width of the windows in which normals are fitted, pixels. 0: the smallest from 3 to 9 in which the
  /// scan's own noise tilts normals by less than 1.7 degrees.
  int normal_window_px = 0;
  int edge_margin_px = 1;        ///< Pixels this close to a depth step are dropped: they may be mixed.
  double min_window_fill = 0.6;  ///< A pixel whose window holds fewer measurements lies at the rim.
};

/// Throws InputError naming the option that is out of range.
void validate(const PreprocessOptions& options);

/// Makes one scan ready for registration, on its pixel grid: points at depth steps dropped with a margin
/// (mixed pixels), a plane fitted to the window around every pixel for its normal, outliers dropped by their
/// distance from that plane and grazing surface by its angle, the rim of the data marked, and the noise of
/// the sensor told from second differences along the rows.
///
/// A scan without a grid is laid out on a virtual one first: the pixels of a sensor at the origin when the
/// points can have been seen from there, otherwise parallel rays along the direction in which the fewest
/// points hide others. From there on it takes the same path, so it reaches the same accuracy, and no
/// search for neighbours slows it down. What a single view cannot show, points behind others, is dropped
/// and counted in `dropped_hidden`: many of them mean that the scan was merged from several views.
///
/// Points at the very origin, which many sensors write where they measured nothing, count as not measured.
/// Throws InputError naming the option that is out of range, or the scan when fewer than 100 points remain or
/// a few lie so far away from the others that no grid holds all of them.
RangeSurface make_range_surface(const TaggedScan& scan, const PreprocessOptions& options);

/// A scan's surface as points, without the grid: what the paper's methods work on. In the `sensor` frame,
/// with normals towards the sensor and a standard uncertainty along the normal for each point.
struct ScanSurface {
  std::string name;
  UncertainPose part_from_sensor;  ///< As tagged.
  PointCloud cloud;                ///< With normals and sigma_mm.
  std::vector<unsigned char> rim;  ///< 1: at the border of the data; nothing may be matched to it.
  double spacing_mm = 0;           ///< Median distance of neighbouring points.
  double noise_mm = 0;             ///< Median standard uncertainty of the points.
  size_t measured = 0;             ///< Valid points before preprocessing.
  size_t dropped_crop = 0;         ///< Outside the part's volume.
  size_t dropped_edges = 0;        ///< At depth steps, outliers, grazing, or without enough neighbours.
  size_t dropped_hidden = 0;       ///< Of a scan without grid: behind other points of it.
};

ScanSurface scan_surface(const RangeSurface& surface);

/// make_range_surface() and scan_surface() in one step.
ScanSurface preprocess(const TaggedScan& scan, const PreprocessOptions& options);

}  // namespace gantry
