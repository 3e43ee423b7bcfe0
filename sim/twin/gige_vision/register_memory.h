#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "gvcp.h"

namespace gantry::gige {

/// The camera's address space: a few blocks of bytes with nothing in between. What a client may do is
/// decided here (addresses, alignment, write protection); what a write means is decided elsewhere.
class RegisterMemory {
 public:
  /// Zeroes, read-only. Blocks must not touch each other.
  void add_block(uint32_t address, uint32_t size);
  void allow_write(uint32_t address) { writable_.insert(address); }

  GvcpStatus read(uint32_t address, std::span<uint8_t> out) const;
  /// Whether a client may write this word, by address alone.
  GvcpStatus check_write(uint32_t address) const;

  // For the camera itself: the address must exist.
  uint32_t u32(uint32_t address) const;
  float f32(uint32_t address) const;
  void set_u32(uint32_t address, uint32_t value);
  void set_u64(uint32_t address, uint64_t value);
  void set_f32(uint32_t address, float value);
  void set_bytes(uint32_t address, std::span<const uint8_t> bytes);
  /// Pads with zeroes to `size`; the string must be shorter than that.
  void set_text(uint32_t address, const std::string& text, uint32_t size);

 private:
  struct Place {
    uint32_t block;  ///< Key in blocks_.
    size_t offset;
  };
  /// Nothing if [address, address + size) does not lie within one block.
  std::optional<Place> locate(uint32_t address, size_t size) const;

  std::map<uint32_t, std::vector<uint8_t>> blocks_;  ///< By first address.
  std::set<uint32_t> writable_;
};

}  // namespace gantry::gige
