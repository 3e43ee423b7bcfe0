#include "gantry/foundation/strict_yaml.h"

#include <yaml-cpp/eventhandler.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

std::string shown(const YAML::Node& node) {
  if (node.IsScalar()) return "'" + node.Scalar() + "'";
  if (node.IsSequence()) return "a list of " + std::to_string(node.size());
  if (node.IsMap()) return "a mapping";
  return "nothing";
}

std::string shown(double value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

/// Notes where documents begin and ignores what is in them.
class DocumentStarts final : public YAML::EventHandler {
 public:
  void OnDocumentStart(const YAML::Mark& mark) override { marks.push_back(mark); }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark&, YAML::anchor_t) override {}
  void OnAlias(const YAML::Mark&, YAML::anchor_t) override {}
  void OnScalar(const YAML::Mark&, const std::string&, YAML::anchor_t, const std::string&) override {}
  void OnSequenceStart(const YAML::Mark&, const std::string&, YAML::anchor_t,
                       YAML::EmitterStyle::value) override {}
  void OnSequenceEnd() override {}
  void OnMapStart(const YAML::Mark&, const std::string&, YAML::anchor_t, YAML::EmitterStyle::value) override {
  }
  void OnMapEnd() override {}

  std::vector<YAML::Mark> marks;
};

/// Not by YAML::LoadAll: where yaml-cpp gets stuck (a comma at the top is enough) it loads the same
/// document again and again until memory ends.
void require_one_document(const std::string& text, const std::string& name) {
  std::istringstream stream(text);
  YAML::Parser parser(stream);
  DocumentStarts starts;
  while (starts.marks.size() < 2 && parser.HandleNextDocument(starts)) {
  }
  if (starts.marks.size() < 2) return;
  const std::string where = name + ":" + std::to_string(starts.marks[1].line + 1) + ": ";
  if (starts.marks[1].pos <= starts.marks[0].pos) throw InputError(where + "not valid YAML");
  throw InputError(where + "expected one YAML document, found a second one");
}

YAML::Node parse_or_throw(const std::string& text, const std::string& name) {
  try {
    require_one_document(text, name);
    const YAML::Node node = YAML::Load(text);
    if (!node.IsMap())
      throw InputError(name + ": expected a mapping (key: value) at the top, found " + shown(node));
    return node;
  } catch (const YAML::Exception& e) {
    throw InputError(name + ":" + std::to_string(e.mark.line + 1) + ": not valid YAML: " + e.msg);
  }
}

}  // namespace

StrictYaml::StrictYaml(YAML::Node node, std::filesystem::path file, std::string path)
    : node_(std::move(node)), file_(std::move(file)), path_(std::move(path)) {
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    // Checked here because yaml-cpp itself accepts a repeated key and keeps the first.
    if (!entry.first.IsScalar()) fail("", "every key must be a plain word");
    if (!seen.insert(entry.first.Scalar()).second) fail(entry.first.Scalar(), "this key is given twice");
  }
}

StrictYaml StrictYaml::load(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream || std::filesystem::is_directory(file))
    throw InputError(file.string() + ": cannot be opened for reading");
  std::stringstream text;
  text << stream.rdbuf();
  return StrictYaml(parse_or_throw(text.str(), file.string()), file, "");
}

StrictYaml StrictYaml::parse(const std::string& text, const std::string& name) {
  return StrictYaml(parse_or_throw(text, name), name, "");
}

bool StrictYaml::has(const std::string& key) const {
  const YAML::Node& constant = node_;
  return static_cast<bool>(constant[key]);
}

void StrictYaml::fail(const std::string& key, const std::string& message) const {
  YAML::Mark mark = node_.Mark();
  for (const auto& entry : node_)
    if (entry.first.IsScalar() && entry.first.Scalar() == key) mark = entry.first.Mark();
  std::string where = path_;
  if (!key.empty()) where += (where.empty() ? "" : ".") + key;
  throw InputError(file_.string() + ":" + std::to_string(mark.line + 1) + ": " +
                   (where.empty() ? "" : where + ": ") + message);
}

YAML::Node StrictYaml::require(const std::string& key) {
  if (!has(key)) fail("", "missing key '" + key + "'");
  read_.insert(key);
  const YAML::Node& constant = node_;
  return constant[key];
}

double StrictYaml::to_number(const YAML::Node& node, const std::string& key, Range range) const {
  double value = 0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) || !std::isfinite(value))
    fail(key, "expected a number, found " + shown(node));
  if (value < range.min || value > range.max)
    fail(key, "expected a number from " + shown(range.min) + " to " + shown(range.max) + ", found " +
                  shown(value));
  return value;
}

double StrictYaml::number(const std::string& key, Range range) {
  return to_number(require(key), key, range);
}

double StrictYaml::number_or(const std::string& key, double fallback, Range range) {
  return has(key) ? number(key, range) : fallback;
}

int StrictYaml::integer(const std::string& key, int min, int max) {
  const double value = number(key, {static_cast<double>(min), static_cast<double>(max)});
  if (value != std::floor(value)) fail(key, "expected a whole number, found " + shown(value));
  return static_cast<int>(value);
}

int StrictYaml::integer_or(const std::string& key, int fallback, int min, int max) {
  return has(key) ? integer(key, min, max) : fallback;
}

bool StrictYaml::boolean_or(const std::string& key, bool fallback) {
  if (!has(key)) return fallback;
  const YAML::Node node = require(key);
  bool value = false;
  if (!node.IsScalar() || !YAML::convert<bool>::decode(node, value))
    fail(key, "expected true or false, found " + shown(node));
  return value;
}

std::string StrictYaml::text(const std::string& key) {
  const YAML::Node node = require(key);
  if (!node.IsScalar() || node.Scalar().empty()) fail(key, "expected a text, found " + shown(node));
  return node.Scalar();
}

std::string StrictYaml::text_or(const std::string& key, const std::string& fallback) {
  return has(key) ? text(key) : fallback;
}

std::string StrictYaml::choice(const std::string& key, const std::vector<std::string>& choices) {
  const std::string value = text(key);
  std::string list;
  for (const auto& each : choices) {
    if (each == value) return value;
    list += (list.empty() ? "" : ", ") + each;
  }
  fail(key, "expected one of " + list + "; found '" + value + "'");
}

double StrictYaml::angle_deg(const std::string& key, Range range_deg) {
  return number(key, range_deg) * kRadPerDeg;
}

double StrictYaml::angle_deg_or(const std::string& key, double fallback_deg, Range range_deg) {
  return number_or(key, fallback_deg, range_deg) * kRadPerDeg;
}

std::vector<double> StrictYaml::numbers(const std::string& key) {
  const YAML::Node node = require(key);
  if (!node.IsSequence()) fail(key, "expected a list of numbers, found " + shown(node));
  std::vector<double> values;
  for (const auto& each : node) values.push_back(to_number(each, key, {}));
  return values;
}

Eigen::Vector3d StrictYaml::vector3(const std::string& key) {
  const std::vector<double> values = numbers(key);
  if (values.size() != 3)
    fail(key, "expected three numbers [x, y, z], found " + std::to_string(values.size()));
  return {values[0], values[1], values[2]};
}

Eigen::Vector3d StrictYaml::vector3_or(const std::string& key, const Eigen::Vector3d& fallback) {
  return has(key) ? vector3(key) : fallback;
}

Eigen::Vector2d StrictYaml::interval(const std::string& key) {
  const std::vector<double> values = numbers(key);
  if (values.size() != 2)
    fail(key, "expected two numbers [lower, upper], found " + std::to_string(values.size()));
  if (!(values[0] < values[1]))
    fail(key, "expected lower < upper, found [" + shown(values[0]) + ", " + shown(values[1]) + "]");
  return {values[0], values[1]};
}

std::filesystem::path StrictYaml::path(const std::string& key) {
  const std::filesystem::path value = text(key);
  return value.is_absolute() ? value : (file_.parent_path() / value).lexically_normal();
}

StrictYaml StrictYaml::map(const std::string& key) {
  const YAML::Node node = require(key);
  if (!node.IsMap()) fail(key, "expected a mapping, found " + shown(node));
  return StrictYaml(node, file_, path_.empty() ? key : path_ + "." + key);
}

std::optional<StrictYaml> StrictYaml::map_if_present(const std::string& key) {
  if (!has(key)) return std::nullopt;
  return map(key);
}

std::vector<StrictYaml> StrictYaml::maps(const std::string& key, size_t min_size) {
  const YAML::Node node = require(key);
  if (!node.IsSequence()) fail(key, "expected a list, found " + shown(node));
  if (node.size() < min_size)
    fail(key,
         "expected at least " + std::to_string(min_size) + " entries, found " + std::to_string(node.size()));
  std::vector<StrictYaml> entries;
  for (size_t i = 0; i < node.size(); ++i) {
    if (!node[i].IsMap())
      fail(key, "entry " + std::to_string(i) + ": expected a mapping, found " + shown(node[i]));
    entries.push_back(StrictYaml(node[i], file_,
                                 (path_.empty() ? key : path_ + "." + key) + "[" + std::to_string(i) + "]"));
  }
  return entries;
}

void StrictYaml::leave_to_others(const std::string& key) {
  read_.insert(key);
}

void StrictYaml::finish() const {
  for (const auto& entry : node_) {
    const std::string key = entry.first.Scalar();
    if (read_.contains(key)) continue;
    std::string known;
    for (const auto& each : read_) known += (known.empty() ? "" : ", ") + each;
    fail(key, "unknown key; known here: " + known);
  }
}

}  // namespace gantry
