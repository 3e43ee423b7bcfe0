#pragma once

#include <string>

#include "gantry/inspection/cad_faces.h"

namespace gantry::internal {

/// A face for a person: "plane, normal +z, through z = 2.0 mm", "hole of 8.0 mm along z at x 20.0, y 10.0",
/// "inside rounding of radius 3.0 mm along y at x 5.0, z 5.0". A cylinder that goes round by less than 3/4 is
/// a rounding; material inside makes it an outside one.
std::string face_words(const CadFace& face);

}  // namespace gantry::internal
