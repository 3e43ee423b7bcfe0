#pragma once

#include <string>
#include <vector>

#include "gantry/inspection/inspection.h"
#include "report/colour_scale.h"
#include "report/measured_surface.h"
#include "report/sections.h"
#include "report/surface_model.h"

namespace gantry::report {

/// What the interactive view (web/viewer.js) draws, as one JSON object. Lists of numbers are little-endian
/// arrays in base64: positions as 16 bits a coordinate over `low` ... `low + size`, corners of triangles as
/// differences from one to the next, each in as many bytes as it needs. Holds numbers only, no text that came
/// from a file. 2 to 4 MB for 160 000 triangles.
std::string viewer_data(const SurfaceModel& model, const MeasuredSurface& measured,
                        const ColourScale& colours, const std::vector<Defect>& defects,
                        const std::vector<Section>& sections);

}  // namespace gantry::report
