#include "number_reader.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <fstream>
#include <sstream>

#include "file_guard.h"
#include "gantry/foundation/error.h"

namespace gantry::internal {
namespace {

constexpr std::string_view kBlank = " \t\r\n\v\f";

template <typename T>
double decode(const char* bytes, bool big_endian) {
  char copy[sizeof(T)];
  std::copy_n(bytes, sizeof(T), copy);
  if (big_endian != (std::endian::native == std::endian::big)) std::reverse(copy, copy + sizeof(T));
  T value;
  std::memcpy(&value, copy, sizeof(T));
  return static_cast<double>(value);
}

}  // namespace

std::string read_file(const std::filesystem::path& path) {
  require_file(path);
  std::ifstream file(path, std::ios::binary);
  std::string bytes(std::filesystem::file_size(path), '\0');
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())))
    throw InputError(path.string() + ": cannot be read");
  return bytes;
}

std::vector<std::string> HeaderReader::next_line() {
  for (;;) {
    const size_t end = bytes_.find('\n', at_);
    ++line_;
    if (end == std::string_view::npos) fail("the header is broken or truncated: it does not end");
    std::istringstream line{std::string(bytes_.substr(at_, end - at_))};
    at_ = end + 1;
    std::vector<std::string> words;
    for (std::string word; line >> word;) words.push_back(word);
    if (!words.empty() && words[0][0] != '#') return words;
  }
}

void HeaderReader::fail(const std::string& message) const {
  throw InputError(path_.string() + ":" + std::to_string(line_) + ": " + message);
}

size_t HeaderReader::count(const std::vector<std::string>& words, size_t index) const {
  size_t value = 0;
  if (index < words.size()) {
    const std::string& word = words[index];
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error == std::errc() && end == word.data() + word.size()) return value;
    fail("expected a whole number, found '" + word + "'");
  }
  fail("expected a whole number behind '" + words[0] + "'");
}

double HeaderReader::number(const std::vector<std::string>& words, size_t index) const {
  if (index < words.size())
    if (const auto value = parse_number(words[index])) return *value;
  fail("expected " + std::to_string(index) + " numbers behind '" + words[0] + "'");
}

double decode_number(const char* bytes, NumberType type, bool big_endian) {
  switch (type.kind) {
    case NumberKind::kFloat:
      return type.bytes == 4 ? decode<float>(bytes, big_endian) : decode<double>(bytes, big_endian);
    case NumberKind::kSigned:
      if (type.bytes == 1) return decode<int8_t>(bytes, big_endian);
      if (type.bytes == 2) return decode<int16_t>(bytes, big_endian);
      return type.bytes == 4 ? decode<int32_t>(bytes, big_endian) : decode<int64_t>(bytes, big_endian);
    case NumberKind::kUnsigned:
      if (type.bytes == 1) return decode<uint8_t>(bytes, big_endian);
      if (type.bytes == 2) return decode<uint16_t>(bytes, big_endian);
      return type.bytes == 4 ? decode<uint32_t>(bytes, big_endian) : decode<uint64_t>(bytes, big_endian);
  }
  return 0;
}

std::optional<double> parse_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (end != word.data() + word.size() || word.empty() || error == std::errc::invalid_argument)
    return std::nullopt;
  // What a double cannot hold is too large to be a coordinate, or too small to be another one than zero.
  if (error == std::errc::result_out_of_range) return std::strtod(std::string(word).c_str(), nullptr);
  return value;
}

double NumberReader::next(NumberType type) {
  if (encoding_ == Encoding::kAscii) return next_word();
  if (bytes_.size() - at_ < type.bytes) throw InputError(path_.string() + ": is truncated");
  const double value = decode_number(bytes_.data() + at_, type, encoding_ == Encoding::kBigEndian);
  at_ += type.bytes;
  return value;
}

double NumberReader::next_word() {
  const size_t begin = bytes_.find_first_not_of(kBlank, at_);
  if (begin == std::string_view::npos) throw InputError(path_.string() + ": is truncated");
  const size_t end = std::min(bytes_.find_first_of(kBlank, begin), bytes_.size());
  at_ = end;
  const std::string_view word = bytes_.substr(begin, end - begin);
  if (const auto value = parse_number(word)) return *value;
  throw InputError(path_.string() + ": expected a number, found '" + std::string(word.substr(0, 40)) + "'");
}

void NumberReader::require_room(size_t count, size_t row_bytes, const std::string& what) const {
  const size_t left =
      bytes_.size() - at_ + (encoding_ == Encoding::kAscii);  // the last line may lack its end
  if (row_bytes == 0 || count > left / row_bytes)
    throw InputError(path_.string() + ": is truncated: " + std::to_string(count) + " " + what +
                     " announced, " + std::to_string(bytes_.size() - at_) + " bytes left");
}

}  // namespace gantry::internal
