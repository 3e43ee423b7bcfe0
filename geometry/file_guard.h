#pragma once

#include <filesystem>
#include <string>

namespace gantry::internal {

/// Throws InputError unless `path` is a file with a line that starts with `word`: the last line of its
/// header. The libraries that read the rest loop or crash on a header that breaks off.
void require_header(const std::filesystem::path& path, const std::string& word);

/// fsyncs `partial`, renames it to `path`, and fsyncs the folder: after that the file survives a power cut.
void publish(const std::filesystem::path& partial, const std::filesystem::path& path);

}  // namespace gantry::internal
