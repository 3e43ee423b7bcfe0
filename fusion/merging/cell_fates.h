#pragma once

#include <cstddef>

#include "merging/cell_grid.h"

namespace gantry::internal {

/// What becomes of a cell; kept in Cell::tag once all scans are in.
enum Fate : uint16_t {
  kPoint,         ///< A point of the merged cloud.
  kUnsupported,   ///< Outlier: too few measurements around.
  kContradicted,  ///< Outlier: alone, off a surface on which several scans agree.
  kAbsorbed,      ///< Made one with a neighbour.
  kThinned        ///< Too near to a chosen point.
};

/// Decides on outliers and absorbs near-duplicates: two cells that are each other's nearest, face the same
/// way and lie less than half a cell apart. Every cell decides for itself by what it reads of its neighbours,
/// so that the result does not depend on the order.
void decide_fates(CellGrid& grid, double cell_mm, size_t min_support);

/// Chooses points that keep a distance of 0.7 cells, with all others within that distance of a chosen one: a
/// maximal independent set by random priorities (Luby 1986). That distance leaves 0.85 to 1 points to the
/// square of a cell on planes of any slope, where there were 1 to 1.7. Run after decide_fates.
void thin_evenly(CellGrid& grid);

}  // namespace gantry::internal
