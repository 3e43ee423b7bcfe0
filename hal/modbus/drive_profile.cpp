#include "modbus/drive_profile.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>

#include "gantry/foundation/strict_yaml.h"
#include "gantry/hal/drive_profile.h"
#include "modbus/modbus_pdu.h"

namespace gantry {
namespace {

/// Addresses are written as manuals print them: 0x9000, or 36864.
uint16_t read_address(StrictYaml& yaml, const std::string& key) {
  const std::string text = yaml.text(key);
  char* end = nullptr;
  errno = 0;
  const long value = std::strtol(text.c_str(), &end, 0);
  if (text.empty() || !end || *end != '\0' || errno != 0 || value < 0 || value > 0xFFFF)
    yaml.fail(key, "expected an address from 0 to 0xFFFF, found '" + text + "'");
  return static_cast<uint16_t>(value);
}

/// A positive number; whole ones also as 0x1111.
double read_number(StrictYaml& yaml, const std::string& key) {
  if (yaml.text(key).starts_with("0x")) return read_address(yaml, key);
  return yaml.number(key, {1e-9, 4294967295.0});
}

template <typename T>
T read_choice(StrictYaml& yaml, const std::string& key,
              const std::vector<std::pair<const char*, T>>& choices) {
  std::vector<std::string> names;
  for (const auto& [name, value] : choices) names.emplace_back(name);
  const std::string chosen = yaml.choice(key, names);
  return std::find_if(choices.begin(), choices.end(), [&](const auto& c) { return chosen == c.first; })
      ->second;
}

Register read_register(StrictYaml yaml) {
  Register result;
  result.address = read_address(yaml, "address");
  result.type = read_choice<RegisterType>(yaml, "type",
                                          {{"u16", RegisterType::kU16},
                                           {"i16", RegisterType::kI16},
                                           {"u32", RegisterType::kU32},
                                           {"i32", RegisterType::kI32},
                                           {"f32", RegisterType::kF32}});
  if (result.address + words_of(result.type) > 0x10000)
    yaml.fail("address", "a 32-bit value does not fit at the last address");
  yaml.finish();
  return result;
}

StatusBit read_bit(StrictYaml yaml, const DriveProfile& profile) {
  StatusBit result;
  const std::string name = yaml.text("register");
  const auto word = profile.registers.find(name);
  if (word == profile.registers.end()) yaml.fail("register", "there is no register '" + name + "' above");
  if (word->second.type == RegisterType::kF32) yaml.fail("register", "a float has no status bits");
  result.register_name = name;
  result.word = word->second;
  result.bit = yaml.integer("bit", 0, static_cast<int>(16 * words_of(result.word.type)) - 1);
  result.active_low = yaml.boolean_or("active_low", false);
  yaml.finish();
  return result;
}

/// Reads what is given of one section; what the kind requires must be given here or in the base profile.
template <typename T, typename Read>
void read_section(StrictYaml& yaml, const std::string& section, const std::vector<ProfileName>& names,
                  std::map<std::string, T>& values, const Read& read) {
  std::optional<StrictYaml> map = yaml.map_if_present(section);
  for (const ProfileName& name : names) {
    if (map && map->has(name.name)) {
      values[name.name] = read(*map, name.name);
    } else if (name.need == ProfileName::Need::kRequired && !values.contains(name.name)) {
      if (map) map->fail("", std::string("missing key '") + name.name + "'");
      yaml.fail("", "missing key '" + section + "', with '" + name.name + "' in it");
    }
  }
  if (map) map->finish();
}

void read_status_ranges(StrictYaml& yaml, DriveProfile& profile) {
  if (!yaml.has("status")) {
    if (profile.status.empty()) yaml.fail("", "missing key 'status'");
    return;
  }
  profile.status.clear();
  for (StrictYaml& range : yaml.maps("status")) {
    const uint16_t first = read_address(range, "first");
    const int count = range.integer("count", 1, modbus_pdu::kMaxReadRegisters);
    if (first + count > 0x10000) range.fail("count", "the range ends behind the last address");
    profile.status.push_back({first, static_cast<uint16_t>(count)});
    range.finish();
  }
}

bool covers(const std::vector<RegisterRange>& ranges, const Register& word) {
  return std::any_of(ranges.begin(), ranges.end(), [&](const RegisterRange& range) {
    return word.address >= range.first &&
           word.address + words_of(word.type) <= range.first + size_t{range.count};
  });
}

void check_layout(StrictYaml& yaml, const DriveKind& kind, const DriveProfile& profile) {
  for (const char* name : kind.in_status) {
    const auto word = profile.find_register(name);
    if (word && !covers(profile.status, *word))
      yaml.fail("status", std::string("register '") + name + "' lies in none of these ranges");
  }
  for (const auto& [name, bit] : profile.bits)
    if (!covers(profile.status, bit.word))
      yaml.fail("status", "the register of bit '" + name + "' lies in none of these ranges");
  for (size_t i = 1; i < kind.block.size(); ++i) {
    const Register &before = profile.reg(kind.block[i - 1]), &here = profile.reg(kind.block[i]);
    if (before.address + words_of(before.type) != here.address)
      yaml.fail("registers", std::string("'") + kind.block[i] + "' must follow directly on '" +
                                 kind.block[i - 1] + "': one write sets them together");
  }
}

const EmbeddedProfile* find_embedded(const std::string& name) {
  for (const EmbeddedProfile& profile : embedded_profiles())
    if (name == profile.name) return &profile;
  return nullptr;
}

std::string list_of_shipped() {
  std::string list;
  for (const std::string& name : shipped_drive_profiles()) list += (list.empty() ? "" : ", ") + name;
  return list;
}

DriveProfile read_profile(StrictYaml yaml, bool may_have_base) {
  DriveProfile profile;
  if (may_have_base && yaml.has("based_on")) {
    const std::string base = yaml.text("based_on");
    const EmbeddedProfile* const embedded = find_embedded(base);
    if (!embedded)
      yaml.fail("based_on", "there is no drive profile '" + base + "'; there is: " + list_of_shipped());
    profile = read_profile(StrictYaml::parse(embedded->text, base + ".yaml"), false);
    if (yaml.has("kind")) yaml.fail("kind", "the kind is that of the profile that this one is based on");
    profile.model = yaml.text_or("model", profile.model);
  } else {
    profile.model = yaml.text("model");
    std::vector<std::string> kinds;
    for (const DriveKind& kind : drive_kinds()) kinds.emplace_back(kind.kind);
    profile.kind = yaml.choice("kind", kinds);
  }
  yaml.text_or("source", "");
  const bool based = !profile.registers.empty();
  if (!based || yaml.has("moves")) {
    const std::string moves = yaml.choice("moves", {"linear", "rotary", "both"});
    profile.linear = moves != "rotary";
    profile.rotary = moves != "linear";
  }
  if (!based || yaml.has("word_order"))
    profile.word_order = read_choice<WordOrder>(yaml, "word_order",
                                                {{"ABCD", WordOrder::kABCD},
                                                 {"CDAB", WordOrder::kCDAB},
                                                 {"BADC", WordOrder::kBADC},
                                                 {"DCBA", WordOrder::kDCBA}});

  const DriveKind& kind = *std::find_if(drive_kinds().begin(), drive_kinds().end(),
                                        [&](const DriveKind& k) { return profile.kind == k.kind; });
  read_status_ranges(yaml, profile);
  read_section(yaml, "registers", kind.registers, profile.registers,
               [](StrictYaml& map, const char* name) { return read_register(map.map(name)); });
  for (auto& [name, bit] : profile.bits) bit.word = profile.reg(bit.register_name);  // moved, perhaps
  read_section(yaml, "bits", kind.bits, profile.bits,
               [&](StrictYaml& map, const char* name) { return read_bit(map.map(name), profile); });
  read_section(yaml, "coils", kind.coils, profile.coils, read_address);
  read_section(yaml, "numbers", kind.numbers, profile.numbers, read_number);
  if (profile.registers.contains("communication_timeout") &&
      !profile.numbers.contains("communication_timeout_unit_s"))
    yaml.fail("numbers", "register 'communication_timeout' needs 'communication_timeout_unit_s' too");
  check_layout(yaml, kind, profile);
  yaml.finish();
  return profile;
}

}  // namespace

std::optional<Register> DriveProfile::find_register(const std::string& name) const {
  const auto found = registers.find(name);
  return found == registers.end() ? std::nullopt : std::optional(found->second);
}
std::optional<StatusBit> DriveProfile::find_bit(const std::string& name) const {
  const auto found = bits.find(name);
  return found == bits.end() ? std::nullopt : std::optional(found->second);
}
std::optional<double> DriveProfile::find_number(const std::string& name) const {
  const auto found = numbers.find(name);
  return found == numbers.end() ? std::nullopt : std::optional(found->second);
}

DriveProfile parse_drive_profile(const std::string& text, const std::string& name) {
  return read_profile(StrictYaml::parse(text, name), true);
}

DriveProfile load_drive_profile(const std::string& name_or_path) {
  const bool file = name_or_path.find('/') != std::string::npos || name_or_path.ends_with(".yaml");
  if (file) return read_profile(StrictYaml::load(name_or_path), true);
  if (const EmbeddedProfile* const embedded = find_embedded(name_or_path))
    return parse_drive_profile(embedded->text, name_or_path + ".yaml");
  throw InputError("there is no drive profile '" + name_or_path + "'; there is: " + list_of_shipped() +
                   ", or give the path of a profile file");
}

DriveProfileFacts drive_profile_facts(const std::string& profile) {
  const DriveProfile loaded = load_drive_profile(profile);
  return {profile,
          loaded.model,
          loaded.kind,
          loaded.linear,
          loaded.rotary,
          loaded.numbers.contains("counts_per_mm"),
          loaded.numbers.contains("counts_per_motor_revolution")};
}

std::vector<std::string> shipped_drive_profiles() {
  std::vector<std::string> names;
  for (const EmbeddedProfile& profile : embedded_profiles()) names.emplace_back(profile.name);
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace gantry
