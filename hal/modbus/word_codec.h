#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

namespace gantry {

// Modbus fixes how a 16-bit register travels (high byte first) and nothing about what is larger: each drive
// family orders the two registers of a 32-bit value as it likes, and some swap the bytes of every register.
// libmodbus's macros shift signed values, and its float helpers do not round-trip, hence these.

/// Where the bytes A (most significant) to D of a 32-bit value travel. A 16-bit value is AB where the first
/// letters are in order (ABCD, CDAB) and BA otherwise.
enum class WordOrder {
  kABCD,  ///< High register first: IAI, Oriental Motor, Leadshine.
  kCDAB,  ///< Low register first: Kinco.
  kBADC,  ///< High register first, bytes swapped.
  kDCBA   ///< Low register first, bytes swapped.
};

/// What a register (or two) holds.
enum class RegisterType { kU16, kI16, kU32, kI32, kF32 };

constexpr size_t words_of(RegisterType type) {
  return type == RegisterType::kU16 || type == RegisterType::kI16 ? 1 : 2;
}

namespace word_codec {

constexpr bool swaps_bytes(WordOrder order) {
  return order == WordOrder::kBADC || order == WordOrder::kDCBA;
}
constexpr bool low_word_first(WordOrder order) {
  return order == WordOrder::kCDAB || order == WordOrder::kDCBA;
}
constexpr uint16_t ordered(uint16_t word, WordOrder order) {
  return swaps_bytes(order) ? static_cast<uint16_t>(word << 8 | word >> 8) : word;
}

}  // namespace word_codec

/// The two registers of 32 bits, in the order of their addresses.
constexpr std::array<uint16_t, 2> words_from_bits(uint32_t bits, WordOrder order) {
  const uint16_t high = word_codec::ordered(static_cast<uint16_t>(bits >> 16), order);
  const uint16_t low = word_codec::ordered(static_cast<uint16_t>(bits & 0xFFFFu), order);
  if (word_codec::low_word_first(order)) return {low, high};
  return {high, low};
}

constexpr uint32_t bits_from_words(uint16_t first, uint16_t second, WordOrder order) {
  const uint16_t a = word_codec::ordered(first, order), b = word_codec::ordered(second, order);
  return word_codec::low_word_first(order) ? static_cast<uint32_t>(b) << 16 | a
                                           : static_cast<uint32_t>(a) << 16 | b;
}

/// The value at the beginning of `words`, which must be at least words_of(type) long. A double holds each of
/// them exactly.
inline double value_from_words(std::span<const uint16_t> words, RegisterType type, WordOrder order) {
  switch (type) {
    case RegisterType::kU16:
      return word_codec::ordered(words[0], order);
    case RegisterType::kI16:
      return static_cast<int16_t>(word_codec::ordered(words[0], order));
    case RegisterType::kU32:
      return bits_from_words(words[0], words[1], order);
    case RegisterType::kI32:
      return static_cast<int32_t>(bits_from_words(words[0], words[1], order));
    case RegisterType::kF32:
      return std::bit_cast<float>(bits_from_words(words[0], words[1], order));
  }
  return std::numeric_limits<double>::quiet_NaN();
}

/// Appends the registers of `value`; an integer is rounded. False, and nothing is appended, when it does not
/// fit (a float: when it is not finite as one).
inline bool append_value(std::vector<uint16_t>& registers, double value, RegisterType type, WordOrder order) {
  const auto within = [](double number, double low, double high) { return number >= low && number <= high; };
  uint32_t bits = 0;
  if (type == RegisterType::kF32) {
    if (!(std::abs(value) <= std::numeric_limits<float>::max())) return false;
    bits = std::bit_cast<uint32_t>(static_cast<float>(value));
  } else {
    const double rounded = std::round(value);
    const bool is_signed = type == RegisterType::kI16 || type == RegisterType::kI32;
    const double span = words_of(type) == 1 ? 0x1p16 : 0x1p32;
    if (!within(rounded, is_signed ? -span / 2 : 0, (is_signed ? span / 2 : span) - 1)) return false;
    bits = static_cast<uint32_t>(static_cast<int64_t>(rounded));
  }
  if (words_of(type) == 1) {
    registers.push_back(word_codec::ordered(static_cast<uint16_t>(bits & 0xFFFFu), order));
  } else {
    const auto words = words_from_bits(bits, order);
    registers.push_back(words[0]);
    registers.push_back(words[1]);
  }
  return true;
}

}  // namespace gantry
