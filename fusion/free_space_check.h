#pragma once

#include <span>

#include "gantry/fusion/range_surface.h"
#include "gantry/fusion/registration.h"

namespace gantry::internal {

/// The judgement of method "joint" (joint/judgement.h), as far as it needs nothing but poses, for methods
/// that do not judge themselves: fills Registration::scans, and Registration::reason when a scan lies where
/// another one looked through. Covers what lies in a wrong basin, not what can slide without touching.
void check_free_space(std::span<const RangeSurface> scans, Registration& registration);

}  // namespace gantry::internal
