#include "gantry/sim/fault_schedule.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "gantry/foundation/strict_yaml.h"

namespace gantry {
namespace {

constexpr double kDegPerRad = 180.0 / std::numbers::pi;
constexpr double kLongest_s = 1e6;

bool is_exchange(FaultMode mode) {
  return mode >= FaultMode::kLoseRequest && mode <= FaultMode::kException;
}

std::string listed(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text.empty() ? "none" : text;
}

std::vector<std::string> names_of(FaultDevice device, const FaultTargetNames& names) {
  std::vector<std::string> out;
  if (device == FaultDevice::kAxis)
    for (const auto& axis : names.axes) out.push_back(axis.name);
  if (device == FaultDevice::kBus) out = names.buses;
  if (device == FaultDevice::kSafety)
    for (const auto& input : names.safety) out.push_back(input.name);
  return out;
}

/// `device: axis linear`, `device: camera`.
void read_device(StrictYaml& yaml, const FaultTargetNames& names, FaultEntry& entry) {
  const std::string text = yaml.text("device");
  const size_t space = text.find(' ');
  const std::string word = text.substr(0, space);
  const std::string name = space == std::string::npos ? "" : text.substr(space + 1);
  using enum FaultDevice;
  for (const FaultDevice device : {kAxis, kBus, kSafety, kCamera}) {
    if (word != to_string(device)) continue;
    entry.device = device;
    entry.name = name;
    if (device == kCamera && name.empty()) return;
    const std::vector<std::string> known = names_of(device, names);
    if (device != kCamera && std::find(known.begin(), known.end(), name) != known.end()) return;
    if (device == kCamera) break;
    yaml.fail("device", "there is no " + word + " '" + name + "' in this cell; there is: " + listed(known));
  }
  yaml.fail("device", "expected 'axis NAME', 'bus NAME', 'safety NAME' or 'camera', found '" + text + "'");
}

const FaultModeInfo& read_mode(StrictYaml& yaml, FaultEntry& entry) {
  std::vector<std::string> words;
  for (const FaultModeInfo& mode : fault_modes())
    if (mode.device == entry.device) words.emplace_back(mode.word);
  const std::string word = yaml.choice("fault", words);
  const auto& modes = fault_modes();
  const auto info = std::find_if(modes.begin(), modes.end(), [&](const FaultModeInfo& m) {
    return m.device == entry.device && m.word == word;
  });
  entry.mode = info->mode;
  return *info;
}

bool is_rotary(const FaultEntry& entry, const FaultTargetNames& names) {
  const auto axis = std::find_if(names.axes.begin(), names.axes.end(),
                                 [&](const FaultTargetNames::Axis& a) { return a.name == entry.name; });
  return axis != names.axes.end() && axis->rotary;
}

void read_parameters(StrictYaml& yaml, const FaultTargetNames& names, FaultEntry& entry) {
  if (is_exchange(entry.mode)) entry.probability = yaml.number_or("probability", 1, {1e-6, 1});
  if (entry.mode == FaultMode::kDelayReply) entry.delay_s = yaml.number("delay_s", {0, 60});
  if (entry.mode == FaultMode::kRunaway) entry.upwards = yaml.choice("direction", {"up", "down"}) == "up";
  if (entry.mode == FaultMode::kSlip)
    entry.distance = is_rotary(entry, names) ? yaml.number("distance_deg", {-360, 360}) / kDegPerRad
                                             : yaml.number("distance_mm", {-1e4, 1e4});
  if (entry.mode == FaultMode::kPress) entry.lag_s = yaml.number_or("lag_s", 0, {0, 60});
  if (entry.mode == FaultMode::kAlarm) entry.code = yaml.integer_or("code", 1, 1, 0xFFFF);
  if (entry.mode == FaultMode::kWireBreak || entry.mode == FaultMode::kStickContact) {
    int contacts = 1;
    for (const auto& input : names.safety)
      if (input.name == entry.name) contacts = input.contacts;
    entry.contact = yaml.integer_or("contact", 0, 0, contacts - 1);
  }
}

FaultEntry read_entry(StrictYaml yaml, const FaultTargetNames& names) {
  FaultEntry entry;
  if (yaml.has("on_event")) {
    StrictYaml event = yaml.map("on_event");
    entry.event = event.choice("kind", {"motion", "exposure"}) == "motion" ? FaultEvent::kMotion
                                                                           : FaultEvent::kExposure;
    entry.event_count = event.integer_or("count", 1, 1, 1000000);
    event.finish();
    entry.at_s = yaml.number_or("at_s", 0, {0, kLongest_s});
  } else {
    entry.at_s = yaml.number("at_s", {0, kLongest_s});
  }
  read_device(yaml, names, entry);
  const FaultModeInfo& mode = read_mode(yaml, entry);
  if (mode.lasts) entry.for_s = yaml.number("for_s", {0.001, kLongest_s});
  read_parameters(yaml, names, entry);
  yaml.finish();
  return entry;
}

/// The shortest text that is read back as the same number.
std::string number(double value) {
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  return {text, end};
}

/// The degrees that are read back as the same radians; their neighbours may be needed for that.
double degrees_for(double rad) {
  const double deg = rad * kDegPerRad;
  for (const double toward : {-1e300, 1e300})
    for (double near = deg, k = 0; k < 4; ++k, near = std::nextafter(near, toward))
      if (near / kDegPerRad == rad) return near;
  return deg;
}

std::string in_quotes(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

std::string entry_text(const FaultEntry& e, const FaultTargetNames& names) {
  std::string text = "  - { ";
  if (e.event)
    text += "on_event: { kind: " + std::string(*e.event == FaultEvent::kMotion ? "motion" : "exposure") +
            ", count: " + std::to_string(e.event_count) + " }, ";
  text += "at_s: " + number(e.at_s);
  if (e.mode != FaultMode::kSlip) text += ", for_s: " + number(e.for_s);
  std::string device(to_string(e.device));
  if (!e.name.empty()) device += " " + e.name;
  text += ", device: " + in_quotes(device) + ", fault: " + std::string(to_string(e.mode));
  if (is_exchange(e.mode)) text += ", probability: " + number(e.probability);
  if (e.mode == FaultMode::kDelayReply) text += ", delay_s: " + number(e.delay_s);
  if (e.mode == FaultMode::kRunaway) text += e.upwards ? ", direction: up" : ", direction: down";
  if (e.mode == FaultMode::kSlip)
    text += is_rotary(e, names) ? ", distance_deg: " + number(degrees_for(e.distance))
                                : ", distance_mm: " + number(e.distance);
  if (e.mode == FaultMode::kPress) text += ", lag_s: " + number(e.lag_s);
  if (e.mode == FaultMode::kAlarm) text += ", code: " + std::to_string(e.code);
  if (e.mode == FaultMode::kWireBreak || e.mode == FaultMode::kStickContact)
    text += ", contact: " + std::to_string(e.contact);
  return text + " }\n";
}

}  // namespace

FaultSchedule read_fault_schedule(const std::filesystem::path& path, const FaultTargetNames& names) {
  StrictYaml yaml = StrictYaml::load(path);
  FaultSchedule schedule;
  // 53 bits: exact in a double, which is what numbers of a file are read as.
  const double seed = yaml.number_or("seed", 1, {0, 9007199254740992.0});
  if (seed != std::floor(seed)) yaml.fail("seed", "expected a whole number");
  schedule.seed = static_cast<uint64_t>(seed);
  for (StrictYaml& entry : yaml.maps("faults", 0))
    schedule.entries.push_back(read_entry(std::move(entry), names));
  yaml.finish();
  return schedule;
}

std::string fault_schedule_text(const FaultSchedule& schedule, const FaultTargetNames& names,
                                const std::string& comment) {
  std::string text;
  for (size_t begin = 0; begin < comment.size();) {
    const size_t end = std::min(comment.find('\n', begin), comment.size());
    text += "# " + comment.substr(begin, end - begin) + "\n";
    begin = end + 1;
  }
  text += "seed: " + std::to_string(schedule.seed) + "\n";
  text += schedule.entries.empty() ? "faults: []\n" : "faults:\n";
  for (const FaultEntry& entry : schedule.entries) text += entry_text(entry, names);
  return text;
}

}  // namespace gantry
