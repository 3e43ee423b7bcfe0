#include "../../hal/modbus/word_codec.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace gantry {
namespace {

TEST(WordCodec, GoldenValuesPutTheHighWordFirst) {
  EXPECT_EQ(to_words(5000), (std::array<uint16_t, 2>{0x0000, 0x1388}));
  EXPECT_EQ(to_words(0x12345678), (std::array<uint16_t, 2>{0x1234, 0x5678}));
  EXPECT_EQ(to_words(-1), (std::array<uint16_t, 2>{0xFFFF, 0xFFFF}));
  EXPECT_EQ(to_words(-8500), (std::array<uint16_t, 2>{0xFFFF, 0xDECC}));
  EXPECT_EQ(from_words(0x8000, 0x0000), std::numeric_limits<int32_t>::min());
}

TEST(WordCodec, EveryValueSurvivesTheRoundTrip) {
  for (const int32_t value : {0, 1, -1, 0x7FFF, 0x8000, -0x8000, 0xFFFF, 0x10000, -0x10000,
                              std::numeric_limits<int32_t>::max(), std::numeric_limits<int32_t>::min()}) {
    const auto words = to_words(value);
    EXPECT_EQ(from_words(words[0], words[1]), value);
  }
  std::mt19937 random(7);
  for (int i = 0; i < 100'000; ++i) {
    const auto value = static_cast<int32_t>(random());
    const auto words = to_words(value);
    ASSERT_EQ(from_words(words[0], words[1]), value);
    ASSERT_EQ(words[0] * 65536ll + words[1] - (value < 0 ? 1ll << 32 : 0), value);
  }
}

TEST(WordCodec, PairsAreReadWhereTheyWereAppended) {
  std::vector<uint16_t> registers{0xAAAA};
  append_words(registers, -2);
  append_words(registers, 70'000);
  ASSERT_EQ(registers.size(), 5u);
  EXPECT_EQ(word_pair(registers, 1), -2);
  EXPECT_EQ(word_pair(registers, 3), 70'000);
}

}  // namespace
}  // namespace gantry
