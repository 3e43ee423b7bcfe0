#pragma once

#include <filesystem>
#include <string>

#include "gantry/geometry/pose.h"

namespace gantry::internal {

/// A pose's uncertainty as comment lines of a PCD header; their form is in scan_file.h.
std::string pcd_tag_comments(const UncertainPose& pose);

/// Reads what the comments of a PCD header say of the pose's uncertainty; returns whether they do.
/// Throws InputError naming the file when the comments are incomplete or not numbers.
bool read_pcd_tag(const std::filesystem::path& path, UncertainPose& pose);

}  // namespace gantry::internal
