#pragma once

#include <vector>

#include "gantry/geometry/ray_scene.h"
#include "report/camera.h"
#include "report/colour_scale.h"
#include "report/image.h"
#include "report/measured_surface.h"

namespace gantry::report {

/// A picture and how far every pixel's surface lies behind the picture plane.
struct Rendering {
  Image image;
  std::vector<float> depth_mm;  ///< Infinite where nothing is.

  /// Whether a surfel of the measured part can be seen at its place in the picture.
  bool shows(const Camera& camera, const Surfel& surfel) const;
};

enum class Colouring {
  kDeviation,  ///< The measured deviations.
  kCoverage    ///< Seen or not seen, nothing else.
};

/// Draws the CAD surface in the colours of the measured deviations, on transparent ground; surface that
/// nobody saw is hatched in grey, measured material beyond the CAD model is drawn as discs, and a fine dark
/// line encloses each defect. The same input gives the same bytes on any number of threads.
Rendering render(const RayScene& cad, const MeasuredSurface& measured, const ColourScale& colours,
                 const Camera& camera, Colouring colouring = Colouring::kDeviation);

}  // namespace gantry::report
