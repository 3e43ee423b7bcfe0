#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include "gantry/foundation/error.h"

namespace gantry {

/// A new folder that goes with its owner.
class TempFolder {
 public:
  TempFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "gantry_test_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder");
    path_ = name;
  }
  ~TempFolder() { std::filesystem::remove_all(path_); }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

inline std::string file_text(const std::filesystem::path& path) {
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

/// One mistake in a file that is otherwise right, and what the message must say of it.
struct Mistake {
  const char* name;
  std::string find;      ///< Text of the right file ...
  std::string replace;   ///< ... and what stands there instead.
  int lines_below;       ///< The line that the message names, counted from where `find` begins.
  std::string expected;  ///< A part of the message: key and cause.
};

inline void PrintTo(const Mistake& mistake, std::ostream* out) {
  *out << mistake.name;
}
inline std::string mistake_name(const testing::TestParamInfo<Mistake>& info) {
  return info.param.name;
}

/// Writes the file with the mistake and expects `read(path)` to throw InputError with "path:line: ...
/// expected".
template <typename Read>
void expect_named(const Mistake& mistake, const std::filesystem::path& original, const Read& read) {
  std::string text = file_text(original);
  const size_t at = text.find(mistake.find);
  ASSERT_NE(at, std::string::npos) << "the shipped file has changed: " << mistake.find;
  const auto line =
      1 + mistake.lines_below + std::count(text.begin(), text.begin() + static_cast<long>(at), '\n');
  text.replace(at, mistake.find.size(), mistake.replace);
  const TempFolder folder;
  const std::filesystem::path path = folder / original.filename().string();
  std::ofstream(path) << text;
  try {
    read(path);
    ADD_FAILURE() << "accepted";
  } catch (const InputError& e) {
    const std::string message = e.what();
    EXPECT_EQ(message.rfind(path.string() + ":" + std::to_string(line) + ": ", 0), 0u)
        << "line " << line << ": " << message;
    EXPECT_NE(message.find(mistake.expected), std::string::npos) << message;
  }
}

}  // namespace gantry
