#include "markdown.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

namespace gantry::bench {
namespace {

/// Characters, not bytes.
size_t width_of(const std::string& s) {
  return static_cast<size_t>(std::count_if(
      s.begin(), s.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

}  // namespace

std::string text(const char* format, ...) {
  va_list arguments, again;
  va_start(arguments, format);
  va_copy(again, arguments);
  const int size = std::vsnprintf(nullptr, 0, format, arguments);
  va_end(arguments);
  std::string out(static_cast<size_t>(std::max(size, 0)), '\0');
  std::vsnprintf(out.data(), out.size() + 1, format, again);
  va_end(again);
  return out;
}

std::string Table::str() const {
  std::vector<size_t> width;
  for (const auto& row : rows_) {
    width.resize(std::max(width.size(), row.size()), 3);
    for (size_t c = 0; c < row.size(); ++c) width[c] = std::max(width[c], width_of(row[c]));
  }
  std::string out;
  for (size_t r = 0; r < rows_.size(); ++r) {
    for (size_t c = 0; c < width.size(); ++c) {
      const std::string cell = c < rows_[r].size() ? rows_[r][c] : "";
      out += "| " + cell + std::string(width[c] - width_of(cell) + 1, ' ');
    }
    out += "|\n";
    if (r > 0) continue;
    for (const size_t w : width) out += "|" + std::string(w + 2, '-');
    out += "|\n";
  }
  return out + "\n";
}

std::string short_number(double value) {
  if (value == 0) return "0";
  if (std::abs(value) < 1e-3) {
    std::string s = text("%.1e", value);  // 1.3e-04
    if (const size_t at = s.find("e-0"); at != std::string::npos) s.erase(at + 2, 1);
    return s;
  }
  if (std::abs(value) >= 10) return text("%.0f", value);
  const int digits = 1 - static_cast<int>(std::floor(std::log10(std::abs(value))));
  return text("%.*f", digits, value);
}

}  // namespace gantry::bench
