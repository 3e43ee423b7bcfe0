#pragma once

#include <filesystem>
#include <string>

#include "gantry/geometry/pose.h"

namespace gantry::internal {

/// A pose's uncertainty as comment lines of a PCD header; their form is in scan_file.h.
std::string pcd_tag_comments(const UncertainPose& pose);

/// Reads what a PCD header says of the pose: its VIEWPOINT in full precision (PCL's reader keeps floats,
/// which are coarser than what repeatable stages hold) and, if there, its uncertainty; returns whether it is.
/// Throws InputError naming the file when the comments are incomplete or not numbers.
bool read_pcd_tag(const std::filesystem::path& path, UncertainPose& pose);

}  // namespace gantry::internal
