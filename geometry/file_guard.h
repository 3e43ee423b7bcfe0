#pragma once

#include <filesystem>

namespace gantry::internal {

/// fsyncs `partial`, renames it to `path`, and fsyncs the folder: after that the file survives a power cut.
void publish(const std::filesystem::path& partial, const std::filesystem::path& path);

}  // namespace gantry::internal
