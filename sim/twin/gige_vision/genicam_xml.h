#pragma once

#include <string>

#include "gantry/sim/twin/gige_vision_camera.h"

namespace gantry::gige {

/// The camera's GenICam description (GenApi 1.1): how every feature maps to its register. SFNC 2.x names.
std::string genicam_xml(const GigeVisionOptions& options);

}  // namespace gantry::gige
