#include "report/text.h"

#include <array>
#include <charconv>
#include <cmath>
#include <fstream>

#include "gantry/foundation/error.h"

namespace gantry::report {
namespace {

constexpr const char* kMinus = "\u2212";
constexpr const char* kDash = "\u2013";

/// Digits of |value|, and whether a minus belongs before them (never before a rounded zero).
std::string digits(double value, int decimals, bool& negative) {
  std::array<char, 400> buffer;
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), std::abs(value),
                                 std::chars_format::fixed, decimals);
  std::string text(buffer.data(), end.ptr);
  negative = value < 0 && text.find_first_not_of("0.") != std::string::npos;
  return text;
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string fixed(double value, int decimals) {
  if (!std::isfinite(value)) return kDash;
  bool negative = false;
  const std::string text = digits(value, decimals, negative);
  return negative ? kMinus + text : text;
}

std::string with_sign(double value, int decimals) {
  if (!std::isfinite(value)) return kDash;
  bool negative = false;
  const std::string text = digits(value, decimals, negative);
  if (negative) return kMinus + text;
  return text.find_first_not_of("0.") == std::string::npos ? text : "+" + text;
}

std::string coordinate(double value) {
  bool negative = false;
  std::string text = digits(std::isfinite(value) ? value : 0.0, 2, negative);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return negative ? "-" + text : text;
}

std::string grouped(size_t count) {
  std::string text = std::to_string(count);
  for (size_t i = text.size(); i > 3; i -= 3) text.insert(i - 3, "\u202f");
  return text;
}

void write_file(const std::filesystem::path& path, std::string_view bytes) {
  std::filesystem::path partial = path;
  partial += ".partial";
  {
    std::ofstream file(partial, std::ios::binary);
    file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    file.close();
    if (!file) throw InputError(path.string() + ": cannot be written");
  }
  std::error_code error;
  std::filesystem::rename(partial, path, error);
  if (error) throw InputError(path.string() + ": cannot be written: " + error.message());
}

}  // namespace gantry::report
