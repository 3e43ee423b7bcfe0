#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gantry::internal {

/// The bytes of a whole file. Throws InputError naming it when it is not there or cannot be read.
std::string read_file(const std::filesystem::path& path);

/// One complete line of a header at a time.
class HeaderReader {
 public:
  HeaderReader(std::string_view bytes, const std::filesystem::path& path) : bytes_(bytes), path_(path) {}

  /// The words of the next line that is neither empty nor (beginning with '#') a comment; the line
  /// must be complete. Throws InputError when the file ends here.
  std::vector<std::string> next_line();
  /// What stands behind the header.
  std::string_view rest() const { return bytes_.substr(at_); }
  /// A whole number in words[index], for example a count. Throws InputError when it is none.
  size_t count(const std::vector<std::string>& words, size_t index) const;
  double number(const std::vector<std::string>& words, size_t index) const;
  /// Throws InputError that names file and line.
  [[noreturn]] void fail(const std::string& message) const;

 private:
  std::string_view bytes_;
  const std::filesystem::path& path_;
  size_t at_ = 0;
  size_t line_ = 0;
};

enum class NumberKind { kSigned, kUnsigned, kFloat };

/// How one number is stored: its kind and its 1, 2, 4 or 8 bytes (4 or 8 for kFloat).
struct NumberType {
  NumberKind kind = NumberKind::kFloat;
  size_t bytes = 4;
};

enum class Encoding { kAscii, kLittleEndian, kBigEndian };

/// The number at `bytes`, which holds type.bytes of them.
double decode_number(const char* bytes, NumberType type, bool big_endian);

/// The number that a word stands for ("-1.5e3", "nan"), if it does.
std::optional<double> parse_number(std::string_view word);

/// One number after the other from the body of a file, whose end it watches.
class NumberReader {
 public:
  NumberReader(std::string_view bytes, Encoding encoding, const std::filesystem::path& path)
      : bytes_(bytes), encoding_(encoding), path_(path) {}

  /// Throws InputError when there is no further number.
  double next(NumberType type);
  /// The least that a number of this type takes in the file, so that a header's claims can be checked
  /// before memory is set aside for them.
  size_t least_bytes(NumberType type) const { return encoding_ == Encoding::kAscii ? 2 : type.bytes; }
  /// Throws InputError unless the body can hold `count` rows of at least `row_bytes` each.
  void require_room(size_t count, size_t row_bytes, const std::string& what) const;

 private:
  double next_word();

  std::string_view bytes_;
  Encoding encoding_;
  const std::filesystem::path& path_;
  size_t at_ = 0;
};

}  // namespace gantry::internal
