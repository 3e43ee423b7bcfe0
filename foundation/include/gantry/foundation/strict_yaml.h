#pragma once

#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace gantry {

/// Bounds that a number must respect, ends included.
struct NumberRange {
  double min = -1e9;
  double max = 1e9;
};

/// One mapping of a YAML file, read strictly: a key that nobody asked for, a missing key or a value
/// of the wrong kind throws InputError with file, line, key and what was expected. Keys that are
/// angles or lengths carry their unit (`tilt_deg`, `travel_mm`); angles are converted to radians by
/// the *_deg readers, so that no degree ever enters the program.
///
///   StrictYaml cell = StrictYaml::load("cell.yaml");
///   double speed = cell.map("drive").number("speed_mm_s", Range{0, 1000});
///   cell.finish();   // throws if a key was left unread
class StrictYaml {
 public:
  using Range = NumberRange;

  static StrictYaml load(const std::filesystem::path& file);
  /// The same, from text; `name` stands for the file in messages.
  static StrictYaml parse(const std::string& text, const std::string& name);

  bool has(const std::string& key) const;

  double number(const std::string& key, Range range = {});
  double number_or(const std::string& key, double fallback, Range range = {});
  int integer(const std::string& key, int min, int max);
  int integer_or(const std::string& key, int fallback, int min, int max);
  bool boolean_or(const std::string& key, bool fallback);
  std::string text(const std::string& key);
  std::string text_or(const std::string& key, const std::string& fallback);
  /// One of `choices`; anything else is an error that lists them.
  std::string choice(const std::string& key, const std::vector<std::string>& choices);
  /// The key must end in `_deg`; the result is in radians. The range is in degrees.
  double angle_deg(const std::string& key, Range range_deg = {});
  double angle_deg_or(const std::string& key, double fallback_deg, Range range_deg = {});
  Eigen::Vector3d vector3(const std::string& key);
  Eigen::Vector3d vector3_or(const std::string& key, const Eigen::Vector3d& fallback);
  /// Two numbers, the first smaller than the second.
  Eigen::Vector2d interval(const std::string& key);
  std::vector<double> numbers(const std::string& key);
  /// A path; a relative one is relative to the folder of this file, not to the working directory.
  std::filesystem::path path(const std::string& key);

  StrictYaml map(const std::string& key);
  std::optional<StrictYaml> map_if_present(const std::string& key);
  /// A list of mappings, at least `min_size` long.
  std::vector<StrictYaml> maps(const std::string& key, size_t min_size = 1);

  /// Declares that another reader owns this key, so that finish() lets it pass.
  void leave_to_others(const std::string& key);
  /// Throws InputError for the first key of this mapping that was never read.
  void finish() const;

  /// Throws InputError pointing at `key` of this mapping (or at the mapping, if there is no such key).
  [[noreturn]] void fail(const std::string& key, const std::string& message) const;

  const std::filesystem::path& file() const { return file_; }

 private:
  StrictYaml(YAML::Node node, std::filesystem::path file, std::string path);
  YAML::Node require(const std::string& key);
  double to_number(const YAML::Node& node, const std::string& key, Range range) const;

  YAML::Node node_;
  std::filesystem::path file_;
  std::string path_;  ///< "axes[1].drive": where this mapping stands in its file.
  std::set<std::string> read_;
};

}  // namespace gantry
