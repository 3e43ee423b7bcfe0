#pragma once

#include <vector>

#include "gantry/inspection/cad_faces.h"
#include "gantry/inspection/inspection.h"
#include "judged_feet.h"
#include "local_surface.h"
#include "surface_coverage.h"

namespace gantry::internal {

/// What is known when defects are looked for. Points are named by their index in `result.cloud`.
struct DefectScene {
  const InspectionResult& result;
  const LocalSurface& surface;
  const SignedDistance& reference;
  const CadFaces& cad;
  const JudgedFeet& feet;
  const CoverageSamples& samples;
  const InspectionOptions& options;
  const CloudSources* sources;  ///< Which scans the points come from; null: not known.

  /// The normal of the CAD triangle that a judged point stands on.
  Eigen::Vector3f foot_normal(size_t i) const {
    return reference.mesh().normal(static_cast<size_t>(feet.triangle[i]));
  }
  size_t face(size_t i) const { return static_cast<size_t>(cad.face_of_triangle[feet.triangle[i]]); }
};

/// Points out of tolerance, in connected regions: those whose feet on the CAD surface are within the linking
/// distance belong together, as do those that are so themselves (the ground that is left of a missing boss
/// stands on its top and on its wall). So are the two faces of a thinner wall, and a dent that shows on both
/// sides of a sheet is one region.
std::vector<std::vector<size_t>> regions_out_of_tolerance(const DefectScene& scene);

/// Joins points closer than `link_mm` (to a third of it) into groups of indices into `points`, each rising.
std::vector<std::vector<size_t>> linked_groups(const std::vector<Eigen::Vector3f>& points, double link_mm);

/// Area, and the integral of the deviation over it, split by sign.
struct RegionExtent {
  double area_mm2 = 0;     ///< Of the measured surface, all faces together.
  double extra_mm3 = 0;    ///< Material too much on the CAD surface below the region ...
  double missing_mm3 = 0;  ///< ... and too little. Points that stand beside the CAD surface take no part.
};
RegionExtent measure_region(const DefectScene& scene, const std::vector<size_t>& members);

/// Area that points with normals sample: occupied cells of a grid across each point's main direction, each
/// counted with the tilt of its surface. `cell_mm` should exceed the points' spacing.
double sampled_area(const PointCloud& cloud, const std::vector<size_t>& members, double cell_mm);

}  // namespace gantry::internal
