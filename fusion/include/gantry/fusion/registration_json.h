#pragma once

#include <filesystem>

#include "gantry/fusion/fusion.h"

namespace gantry {

/// Writes `poses.txt`, `merged.ply` (points, normals, sigma) and `registration.json` (its keys:
/// docs/files.md) into `folder`. Without a merged cloud, an earlier merged.ply there is removed: it would not
/// belong to these poses. Throws InputError when a file cannot be written.
void write_registration(const std::filesystem::path& folder, const FusionResult& result);

}  // namespace gantry
