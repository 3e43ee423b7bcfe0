#pragma once

#include <filesystem>
#include <string>

namespace gantry::internal {

/// Throws InputError naming `path` unless it is a file.
void require_file(const std::filesystem::path& path);

/// ".stl" of PART.STL too: the way CAD programs write it.
std::string lower_extension(const std::filesystem::path& path);

/// fsyncs `partial`, renames it to `path`, and fsyncs the folder: after that the file survives a power cut.
void publish(const std::filesystem::path& partial, const std::filesystem::path& path);

}  // namespace gantry::internal
