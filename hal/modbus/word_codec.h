#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace gantry {

// Modbus registers are 16 bits wide; both drive families put 32-bit values into two consecutive ones,
// high word first, negative numbers as two's complement. libmodbus's macros shift signed values, and
// its float helpers do not round-trip, hence these.

constexpr std::array<uint16_t, 2> to_words(int32_t value) {
  const auto bits = static_cast<uint32_t>(value);
  return {static_cast<uint16_t>(bits >> 16), static_cast<uint16_t>(bits & 0xFFFFu)};
}

constexpr int32_t from_words(uint16_t high, uint16_t low) {
  return static_cast<int32_t>((static_cast<uint32_t>(high) << 16) | low);
}

/// The value in registers[index] and registers[index + 1].
constexpr int32_t word_pair(std::span<const uint16_t> registers, size_t index) {
  return from_words(registers[index], registers[index + 1]);
}

inline void append_words(std::vector<uint16_t>& registers, int32_t value) {
  const auto words = to_words(value);
  registers.insert(registers.end(), words.begin(), words.end());
}

}  // namespace gantry
