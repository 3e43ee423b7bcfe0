#pragma once

#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

namespace gantry::testing {

inline std::string read_text(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

inline void write_text(const std::filesystem::path& path, const std::string& text) { std::ofstream(path) << text; }

/// Replaces every occurrence; throws when there is none, so that a test cannot silently test nothing.
inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  size_t count = 0;
  for (size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size(), ++count)
    text.replace(at, from.size(), to);
  if (count == 0) throw std::runtime_error("'" + from + "' does not occur");
  return text;
}

/// A folder of the test's own, removed at its end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "gantry-test-XXXXXX").string();
    if (!mkdtemp(pattern.data())) throw std::runtime_error("mkdtemp failed");
    path_ = pattern;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

inline const std::filesystem::path kExamples = std::filesystem::path(GANTRY_SOURCE_DIR) / "examples";

/// The shipped demo cell on addresses of the tests' own.
inline std::string twin_cell_text() {
  std::string text = read_text(kExamples / "cells/twin.yaml");
  text = replaced(text, "../parts", (kExamples / "parts").string());
  text = replaced(text, "15021", "15121");
  text = replaced(text, "15022", "15122");
  text = replaced(text, "15023", "15123");
  return replaced(text, "address: 127.0.0.1", "address: 127.0.0.71");
}

/// The same with a sensor of few pixels, for tests that are not about accuracy.
inline std::string small_twin_cell_text() {
  return replaced(replaced(twin_cell_text(), "width_px: 1920", "width_px: 480"), "height_px: 1200", "height_px: 300");
}

inline std::string simulated_cell_text() {
  std::string text = replaced(read_text(kExamples / "cells/simulated.yaml"), "../parts", (kExamples / "parts").string());
  return replaced(replaced(text, "width_px: 1920", "width_px: 480"), "height_px: 1200", "height_px: 300");
}

inline const std::string kThreeViews =
    "name: three views\n"
    "exposure_ms: 20\n"
    "inspection: { tolerance_mm: 0.2 }\n"
    "viewpoints:\n"
    "  - { name: a, joints: { linear_mm: 100, rotation_deg: 20, tilt_deg: 10 } }\n"
    "  - { name: b, joints: { linear_mm: 100, rotation_deg: 0, tilt_deg: 10 } }\n"
    "  - { name: c, joints: { linear_mm: 100, rotation_deg: -20, tilt_deg: 10 } }\n";

}  // namespace gantry::testing
