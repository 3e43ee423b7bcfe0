#pragma once

#include <filesystem>
#include <string>

namespace gantry {

/// SHA-256 of a file's bytes as 64 hexadecimal digits, for traceability: the report names exactly
/// which cell, plan and CAD model a verdict rests on. Throws InputError if it cannot be read.
std::string sha256_of_file(const std::filesystem::path& path);
/// The same, of a text.
std::string sha256_of_text(const std::string& text);

}  // namespace gantry
