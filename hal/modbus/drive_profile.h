#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"
#include "modbus/word_codec.h"

namespace gantry {

struct Register {
  uint16_t address = 0;
  RegisterType type = RegisterType::kU16;
};

/// One bit of a register.
struct StatusBit {
  std::string register_name;
  Register word;
  int bit = 0;
  bool active_low = false;
};

/// Registers that are read with one request.
struct RegisterRange {
  uint16_t first = 0;
  uint16_t count = 0;
};

/// Where a drive keeps what: the data of a profile file, checked against what its kind needs. Names are those
/// of the kind's list (drive_kinds.cpp).
struct DriveProfile {
  std::string model;
  std::string kind;
  bool linear = false, rotary = false;
  WordOrder word_order = WordOrder::kABCD;
  std::vector<RegisterRange> status;  ///< Read in this order for every status.
  std::map<std::string, Register> registers;
  std::map<std::string, StatusBit> bits;
  std::map<std::string, uint16_t> coils;
  std::map<std::string, double> numbers;

  // For names that the kind requires.
  const Register& reg(const std::string& name) const { return registers.at(name); }
  const StatusBit& bit(const std::string& name) const { return bits.at(name); }
  uint16_t coil(const std::string& name) const { return coils.at(name); }
  double number(const std::string& name) const { return numbers.at(name); }

  // For names that may be missing.
  std::optional<Register> find_register(const std::string& name) const;
  std::optional<StatusBit> find_bit(const std::string& name) const;
  std::optional<double> find_number(const std::string& name) const;
};

/// A name in a profile.
struct ProfileName {
  const char* name;
  enum class Need { kRequired, kOptional } need = Need::kRequired;
};

/// What a kind of drive needs to be told, and nothing else may be in its profiles.
struct DriveKind {
  const char* kind;
  std::vector<ProfileName> registers, bits, coils, numbers;
  /// Registers that one write sets together, in this order: they must follow on each other.
  std::vector<const char*> block;
  /// Registers and all bits' registers that every status needs: they must lie within `status`.
  std::vector<const char*> in_status;
};

/// All kinds there are.
const std::vector<DriveKind>& drive_kinds();

/// By name or path, as in DriveProfileFacts. Throws InputError.
DriveProfile load_drive_profile(const std::string& name_or_path);
/// From text, `name` for messages; `based_on` names shipped profiles only.
DriveProfile parse_drive_profile(const std::string& text, const std::string& name);

/// The shipped profile files, generated from hal/profiles when the library is built.
struct EmbeddedProfile {
  const char* name;
  const char* text;
};
std::span<const EmbeddedProfile> embedded_profiles();

}  // namespace gantry
