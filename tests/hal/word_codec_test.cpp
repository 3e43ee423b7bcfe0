#include "modbus/word_codec.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <random>

namespace gantry {
namespace {

using enum WordOrder;
using enum RegisterType;

constexpr WordOrder kOrders[] = {kABCD, kCDAB, kBADC, kDCBA};
constexpr RegisterType kTypes[] = {kU16, kI16, kU32, kI32, kF32};

std::vector<uint16_t> words(double value, RegisterType type, WordOrder order) {
  std::vector<uint16_t> registers;
  EXPECT_TRUE(append_value(registers, value, type, order)) << value;
  return registers;
}

using Words = std::vector<uint16_t>;

TEST(WordCodec, GoldenValues) {
  // The letters are the bytes: A = 12h is the most significant one.
  EXPECT_EQ(words(0x12345678, kI32, kABCD), (Words{0x1234, 0x5678}));
  EXPECT_EQ(words(0x12345678, kI32, kCDAB), (Words{0x5678, 0x1234}));
  EXPECT_EQ(words(0x12345678, kI32, kBADC), (Words{0x3412, 0x7856}));
  EXPECT_EQ(words(0x12345678, kI32, kDCBA), (Words{0x7856, 0x3412}));
  EXPECT_EQ(words(0x1234, kU16, kABCD), (Words{0x1234}));
  EXPECT_EQ(words(0x1234, kU16, kDCBA), (Words{0x3412}));
  EXPECT_EQ(words(-8500, kI32, kABCD), (Words{0xFFFF, 0xDECC}));
  EXPECT_EQ(words(-2, kI16, kABCD), (Words{0xFFFE}));
  EXPECT_EQ(words(1.0, kF32, kABCD), (Words{0x3F80, 0x0000}));  // IEEE 754
  EXPECT_EQ(words(-6.5, kF32, kCDAB), (Words{0x0000, 0xC0D0}));
  // Kinco's manual, 12.3: 00085555h travels as 55 55 00 08.
  EXPECT_EQ(words(0x00085555, kU32, kCDAB), (Words{0x5555, 0x0008}));
  EXPECT_EQ(value_from_words(Words{0x8000, 0}, kI32, kABCD), -2147483648.0);
  EXPECT_EQ(value_from_words(Words{0x8000, 0}, kU32, kABCD), 2147483648.0);
}

/// The bytes of a 32-bit value in the order that the letters say, by hand.
uint32_t by_letters(const Words& registers, const char* letters) {
  const uint8_t bytes[] = {static_cast<uint8_t>(registers[0] >> 8), static_cast<uint8_t>(registers[0]),
                           static_cast<uint8_t>(registers[1] >> 8), static_cast<uint8_t>(registers[1])};
  uint32_t value = 0;
  for (int i = 0; i < 4; ++i) value |= static_cast<uint32_t>(bytes[i]) << 8 * ('D' - letters[i]);
  return value;
}

TEST(WordCodec, EveryValueSurvivesInEveryTypeAndOrder) {
  std::mt19937 random(7);
  for (const WordOrder order : kOrders) {
    for (int i = 0; i < 20'000; ++i) {
      const auto bits = static_cast<uint32_t>(random());
      for (const double value :
           {static_cast<double>(bits), static_cast<double>(static_cast<int32_t>(bits))}) {
        const RegisterType type = value < 0 ? kI32 : kU32;
        const Words registers = words(value, type, order);
        ASSERT_EQ(value_from_words(registers, type, order), value);
      }
      float number;
      std::memcpy(&number, &bits, sizeof number);
      if (!std::isfinite(number)) continue;
      const Words registers = words(number, kF32, order);
      const auto back = static_cast<float>(value_from_words(registers, kF32, order));
      ASSERT_EQ(std::memcmp(&back, &number, sizeof number), 0) << number;
    }
    for (int value = -0x8000; value <= 0xFFFF; ++value) {
      const RegisterType type = value < 0 ? kI16 : kU16;
      ASSERT_EQ(value_from_words(words(value, type, order), type, order), value);
    }
  }
}

TEST(WordCodec, TheOrdersAreWhatTheirLettersSay) {
  const char* const letters[] = {"ABCD", "CDAB", "BADC", "DCBA"};
  std::mt19937 random(8);
  for (int i = 0; i < 1000; ++i) {
    const auto bits = static_cast<uint32_t>(random());
    for (int order = 0; order < 4; ++order)
      ASSERT_EQ(by_letters(words(bits, kU32, kOrders[order]), letters[order]), bits) << letters[order];
  }
}

TEST(WordCodec, WhatDoesNotFitIsRefusedAndLeavesNothing) {
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               infinity = std::numeric_limits<double>::infinity();
  for (const WordOrder order : kOrders) {
    for (const RegisterType type : kTypes) {
      Words registers{0xAAAA};
      EXPECT_FALSE(append_value(registers, nan, type, order));
      EXPECT_FALSE(append_value(registers, infinity, type, order));
      EXPECT_FALSE(append_value(registers, -1e300, type, order));
      EXPECT_EQ(registers, Words{0xAAAA});
    }
  }
  const struct {
    RegisterType type;
    double lowest, highest;
  } ranges[] = {
      {kU16, 0, 65535}, {kI16, -32768, 32767}, {kU32, 0, 4294967295.0}, {kI32, -2147483648.0, 2147483647}};
  for (const auto& range : ranges) {
    Words registers;
    EXPECT_TRUE(append_value(registers, range.lowest, range.type, kABCD));
    EXPECT_TRUE(append_value(registers, range.highest, range.type, kABCD));
    EXPECT_TRUE(append_value(registers, range.highest + 0.4, range.type, kABCD)) << "rounded";
    EXPECT_FALSE(append_value(registers, range.lowest - 1, range.type, kABCD));
    EXPECT_FALSE(append_value(registers, range.highest + 1, range.type, kABCD));
  }
}

}  // namespace
}  // namespace gantry
