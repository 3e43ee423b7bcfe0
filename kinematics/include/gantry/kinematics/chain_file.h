#pragma once

#include "gantry/foundation/strict_yaml.h"
#include "gantry/kinematics/chain.h"

namespace gantry {

/// Reads one `joint:` mapping of CELL.yaml:
///   kind: revolute            # or prismatic
///   direction: [0, 0, 1]      # base frame, any length
///   point_mm: [0, 0, 100]     # revolute only
///   repeatability_deg: 0.002  # or repeatability_mm
///   direction_sigma_deg: 0.02
///   point_sigma_mm: 0.05      # revolute only
Joint read_joint(StrictYaml joint, const std::string& name);

/// Reads a mapping with `position_mm` and `rotation_rpy_deg` (fixed-axis roll, pitch, yaw); other keys
/// are left to the caller.
Pose read_pose(StrictYaml& pose);

}  // namespace gantry
