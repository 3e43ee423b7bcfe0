#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "gantry/fusion/range_surface.h"
#include "gantry/geometry/point_cloud.h"
#include "gantry/geometry/pose.h"

namespace gantry {

struct MergeOptions {
  double voxel_mm = 0;  ///< Edge of the averaging cells; 0: 1.1 times the median point spacing.
  /// Cells that hold, with the 26 around them and facing the same way, fewer measurements are outliers.
  size_t min_support = 4;
  /// Resample so that output points lie evenly, about one to a square of `voxel_mm` wherever the scans are
  /// at least that dense. Otherwise every cell keeps its point: all that was measured, but denser on
  /// slopes and edges.
  bool uniform_density = false;
  /// Share of a measurement's variance that all measurements at a place have in common (calibration of the
  /// sensor, optics of the surface, registration) and that averaging therefore cannot remove, 0..1. The
  /// sigma of a merged point is never below the square root of this share times that of one measurement.
  double correlated_share = 0.04;
};

/// What became of the measurements. Cells are counted, but for `measurements`.
struct MergeReport {
  double voxel_mm = 0;      ///< As used.
  size_t measurements = 0;  ///< Usable pixels of all scans.
  size_t cells = 0;         ///< Occupied; faces of an edge or of a thin wall count apart.
  size_t unsupported = 0;   ///< Dropped: hardly anything around.
  size_t contradicted = 0;  ///< Dropped: off the surface on which several scans agree.
  size_t duplicates = 0;    ///< Made one with the cell beyond a border that cuts through the surface.
  size_t thinned = 0;       ///< Left out for uniform density.
  size_t points = 0;        ///< Of the merged cloud.
  size_t memory_bytes = 0;  ///< Held for cells at the end, and at most for the pixels of one scan.
};

/// One cloud in the part frame from all scans, for the part's inspection.
///
///  - Measurements in a cell whose normals agree within 45 degrees become one point: mean weighted by
///    1 / sigma^2, normals averaged, sigma = 1 / sqrt(sum of weights) but for the floor above. Faces of an
///    edge and of a wall of any thickness stay apart, since their normals differ.
///  - A surface that runs along the border of two cells fills both: two cells that are each other's nearest,
///    less than half a cell apart, become one as well; so does what noise threw over the border.
///  - Which scans a point comes from, and with what weight, is kept (PointCloud::sources); how well these are
///    placed is not known here.
///  - Outliers go: what has no support around, and lone measurements of one scan more than half a cell and
///    4 sigma off the surface on which several scans agree, as mixed pixels at depth edges.
///
/// Scans may come one at a time. Memory follows the surface: about 50 bytes a cell, 12 for each scan that
/// measured it, and 30 bytes a pixel of one scan. Sums are kept relative to their cell, so that a part may lie
/// metres from the origin. The result, with its order of points, is the same on any number of threads.
///
///   CloudMerger merger(options);
///   for (...) merger.add(surface, part_from_sensor);
///   PointCloud merged = merger.finish();
class CloudMerger {
 public:
  /// Throws InputError for options out of range.
  explicit CloudMerger(const MergeOptions& options);
  ~CloudMerger();

  /// With voxel_mm = 0 the first scan's spacing decides. Throws InputError when a point lies more than a
  /// million cells from the origin of the part frame or is not a number; of that scan nothing is taken.
  void add(const RangeSurface& surface, const Pose& part_from_sensor);
  /// Empty when nothing was added. Afterwards the merger is as new.
  PointCloud finish(MergeReport* report = nullptr);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// The same for scans that are all at hand; with voxel_mm = 0 the median of their spacings decides. Throws
/// InputError also when there are not as many poses as scans.
PointCloud merge_surfaces(std::span<const RangeSurface> surfaces, std::span<const Pose> part_from_sensor,
                          const MergeOptions& options, MergeReport* report = nullptr);

}  // namespace gantry
