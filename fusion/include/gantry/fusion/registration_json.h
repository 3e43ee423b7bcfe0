#pragma once

#include <filesystem>

#include "gantry/fusion/fusion.h"

namespace gantry {

/// Writes `poses.txt`, `merged.ply` (points, normals, sigma) and `registration.json` into `folder`.
void write_registration(const std::filesystem::path& folder, const FusionResult& result);

}  // namespace gantry
