#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "gantry/fusion/preprocess.h"

namespace gantry {

/// The cells of a coarse grid in the part frame that a scan's surface occupies, told apart by the direction
/// of the normal, so that the two faces of a wall do not count as common.
class OccupiedCells {
 public:
  /// `cell_mm` should be a few times the error of the pose. Throws InputError when it is not positive.
  OccupiedCells(const ScanSurface& surface, const Pose& part_from_sensor, double cell_mm);
  /// How much surface two scans have in common, as a fraction of the smaller one's. Same `cell_mm` in both.
  double overlap(const OccupiedCells& other) const;

 private:
  std::vector<uint64_t> keys_;  // sorted
};

/// Predicted overlap of two scans by their tagged poses.
double predicted_overlap(const ScanSurface& a, const ScanSurface& b, double cell_mm);

/// Two scans that are predicted to share surface.
struct OverlappingPair {
  size_t target = 0, source = 0;  ///< Indices, target < source.
  double overlap = 0;             ///< Fraction of the smaller one's surface.
  bool neighbours = false;        ///< An edge of the tree that joins all scans by their greatest overlaps.
};

/// All pairs that share at least `min_overlap` at the given poses, in order of (source, target).
std::vector<OverlappingPair> overlapping_pairs(std::span<const ScanSurface> surfaces,
                                               std::span<const Pose> part_from_sensor, double cell_mm,
                                               double min_overlap);

}  // namespace gantry
