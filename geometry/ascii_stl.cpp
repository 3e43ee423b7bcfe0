// STL as text, as it is commonly written (3D Systems, "StereoLithography Interface Specification", 1988):
// solid NAME { facet normal N N N, outer loop, three times vertex X Y Z, endloop, endfacet } endsolid NAME.

#include "ascii_stl.h"

#include <algorithm>
#include <cctype>
#include <fstream>

#include "gantry/foundation/error.h"
#include "number_reader.h"

namespace gantry::internal {
namespace {

constexpr size_t kBinaryHeader = 84, kBinaryFacet = 50;
constexpr std::string_view kBlank = " \t\r\n\v\f";

bool is_word(std::string_view word, std::string_view expected) {
  return std::equal(word.begin(), word.end(), expected.begin(), expected.end(),
                    [](char a, char b) { return std::tolower(static_cast<unsigned char>(a)) == b; });
}

/// One word after the other, and on which line it stands.
class Words {
 public:
  Words(std::string_view text, const std::filesystem::path& path) : text_(text), path_(path) {}

  bool at_end() const { return text_.find_first_not_of(kBlank, at_) == std::string_view::npos; }
  /// Empty at the end.
  std::string_view next() {
    const size_t begin = std::min(text_.find_first_not_of(kBlank, at_), text_.size());
    line_ += static_cast<size_t>(std::count(text_.begin() + static_cast<std::ptrdiff_t>(at_),
                                            text_.begin() + static_cast<std::ptrdiff_t>(begin), '\n'));
    at_ = std::min(text_.find_first_of(kBlank, begin), text_.size());
    return text_.substr(begin, at_ - begin);
  }
  void skip_line() { at_ = std::min(text_.find('\n', at_), text_.size()); }
  void expect(std::string_view expected) {
    if (const std::string_view word = next(); !is_word(word, expected))
      fail("'" + std::string(expected) + "'", word);
  }
  float number() {
    const std::string_view word = next();
    const auto value = parse_number(word);
    if (!value) fail("a number", word);
    return static_cast<float>(*value);
  }
  [[noreturn]] void fail(const std::string& expected, std::string_view found) const {
    std::string shown(found.substr(0, 40));
    for (char& c : shown)
      if (!std::isprint(static_cast<unsigned char>(c))) c = '?';
    throw InputError(path_.string() + ":" + std::to_string(line_) + ": expected " + expected + ", " +
                     (found.empty() ? "but the file ends here: it is truncated" : "found '" + shown + "'"));
  }

 private:
  std::string_view text_;
  const std::filesystem::path& path_;
  size_t at_ = 0;
  size_t line_ = 1;
};

}  // namespace

bool is_ascii_stl(const std::filesystem::path& path) {
  std::string head(kBinaryHeader, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), kBinaryHeader);
  const size_t begin = std::min(head.find_first_not_of(kBlank), head.size());
  if (!is_word(std::string_view(head).substr(begin, 5), "solid")) return false;
  if (!file) return true;  // too short for a binary one
  const double facets = decode_number(head.data() + kBinaryHeader - 4, {NumberKind::kUnsigned, 4}, false);
  return static_cast<double>(std::filesystem::file_size(path)) != kBinaryHeader + kBinaryFacet * facets;
}

TriangleMesh read_ascii_stl(const std::filesystem::path& path) {
  const std::string bytes = read_file(path);
  Words words(bytes, path);
  TriangleMesh soup;
  do {
    words.expect("solid");
    words.skip_line();
    for (std::string_view word = words.next(); !is_word(word, "endsolid"); word = words.next()) {
      if (!is_word(word, "facet")) words.fail("'facet' or 'endsolid'", word);
      words.expect("normal");
      for (int k = 0; k < 3; ++k) words.next();
      words.expect("outer");
      words.expect("loop");
      const auto first = static_cast<int>(soup.vertices.size());
      for (int corner = 0; corner < 3; ++corner) {
        words.expect("vertex");
        const float x = words.number(), y = words.number(), z = words.number();
        soup.vertices.emplace_back(x, y, z);
      }
      soup.triangles.emplace_back(first, first + 1, first + 2);
      words.expect("endloop");
      words.expect("endfacet");
    }
    words.skip_line();
  } while (!words.at_end());
  return soup;
}

}  // namespace gantry::internal
