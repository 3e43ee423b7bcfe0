#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace gantry::gige {

/// GigE Vision is big-endian (network byte order) everywhere but in pixel data.
inline uint16_t get_u16(std::span<const uint8_t> bytes, size_t at) {
  return static_cast<uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}

inline uint32_t get_u32(std::span<const uint8_t> bytes, size_t at) {
  return static_cast<uint32_t>(get_u16(bytes, at)) << 16 | get_u16(bytes, at + 2);
}

inline uint64_t get_u64(std::span<const uint8_t> bytes, size_t at) {
  return static_cast<uint64_t>(get_u32(bytes, at)) << 32 | get_u32(bytes, at + 4);
}

inline void append_u16(std::vector<uint8_t>& bytes, uint16_t value) {
  bytes.push_back(static_cast<uint8_t>(value >> 8));
  bytes.push_back(static_cast<uint8_t>(value));
}

inline void append_u32(std::vector<uint8_t>& bytes, uint32_t value) {
  append_u16(bytes, static_cast<uint16_t>(value >> 16));
  append_u16(bytes, static_cast<uint16_t>(value));
}

inline void append_u64(std::vector<uint8_t>& bytes, uint64_t value) {
  append_u32(bytes, static_cast<uint32_t>(value >> 32));
  append_u32(bytes, static_cast<uint32_t>(value));
}

}  // namespace gantry::gige
