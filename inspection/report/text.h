#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace gantry::report {

/// Text as HTML content or attribute value.
std::string escaped(std::string_view text);

/// A number for a person, independent of the locale; an en dash when it is not finite.
std::string fixed(double value, int decimals);
/// The same with its sign always written (a true minus sign): deviations.
std::string with_sign(double value, int decimals);
/// A coordinate inside SVG: short, with an ASCII minus.
std::string coordinate(double value);
/// "400 123", groups of three digits parted by a narrow space.
std::string grouped(size_t count);

/// Replaces the file in one step. Throws InputError if it cannot be written.
void write_file(const std::filesystem::path& path, std::string_view bytes);

}  // namespace gantry::report
