#pragma once

#include <Eigen/Core>
#include <vector>

#include "gantry/inspection/inspection.h"

namespace gantry::report {

/// A small patch of measured surface: the mean of the judged points of one voxel that face the same way.
struct Surfel {
  Eigen::Vector3f position;  ///< On the CAD surface, or in space for material that the CAD does not have.
  Eigen::Vector3f normal;    ///< Unit, out of the material.
  float deviation_mm;
  float uncertainty_mm;  ///< Standard uncertainty of the deviation.
  int defect;            ///< 0: none.
};

/// What a cloud tells of the part, thinned to a density that does not depend on the cloud's, so that a
/// picture costs the same for any number of points.
struct MeasuredSurface {
  std::vector<Surfel> on_cad;  ///< Points moved to their foot on the CAD surface, to colour it.
  std::vector<Surfel>
      off_cad;         ///< Points that no CAD surface carries (a hole not drilled): shown by themselves.
  float reach_mm = 0;  ///< CAD surface further than this from every `on_cad` was not seen.
  float disc_mm = 0;   ///< Radius at which neighbouring `off_cad` cover the surface.
};

/// The axis along which a normal points most, twice its number, and 1 more if against it: 0 is +x, 5 is -z.
int dominant_axis(const Eigen::Vector3f& normal);

MeasuredSurface measured_surface(const InspectionResult& result, const SignedDistance& reference,
                                 const InspectionOptions& options);

}  // namespace gantry::report
