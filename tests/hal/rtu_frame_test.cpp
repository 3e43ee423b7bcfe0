#include "modbus/rtu_frame.h"

#include <gtest/gtest.h>

#include <random>
#include <sstream>

namespace gantry {
namespace {

using Bytes = modbus_pdu::Bytes;
using State = RtuAnswer::State;

Bytes bytes(const std::string& hex) {
  std::istringstream in(hex);
  Bytes result;
  for (unsigned byte; in >> std::hex >> byte;) result.push_back(static_cast<uint8_t>(byte));
  return result;
}

TEST(RtuFrame, GoldenFramesOfTheManuals) {
  // IAI, 5.5: move to position 1.
  EXPECT_EQ(rtu_frame(1, modbus_pdu::write_register(0x0D03, 1).pdu), bytes("01 06 0D 03 00 01 BA A6"));
  // IAI, 5.5: the same by coils.
  EXPECT_EQ(rtu_frame(1, modbus_pdu::write_coil(0x040C, true).pdu), bytes("01 05 04 0C FF 00 4D 09"));
  EXPECT_EQ(rtu_frame(1, modbus_pdu::write_coil(0x040C, false).pdu), bytes("01 05 04 0C 00 00 0C F9"));
  // Leadshine CS2RS, 5.5.4: path 0 with its immediate trigger, and the drive's answer.
  const uint16_t path[] = {1, 0, 10000, 0, 10000, 10000, 0, 0x10};
  EXPECT_EQ(rtu_frame(7, modbus_pdu::write_registers(0x6200, path).pdu),
            bytes("07 10 62 00 00 08 10 00 01 00 00 27 10 00 00 27 10 27 10 00 00 00 10 8D 50"));
  EXPECT_EQ(rtu_frame(7, modbus_pdu::write_registers(0x6200, path).answer_begin),
            bytes("07 10 62 00 00 08 DE 11"));
  // Kinco FD, 12.3: status word, control word, a 32-bit value low word first.
  EXPECT_EQ(rtu_frame(1, modbus_pdu::read_registers(0x03, 0x3200, 2).pdu), bytes("01 03 32 00 00 02 CA B3"));
  EXPECT_EQ(rtu_frame(1, modbus_pdu::write_register(0x3100, 0x000F).pdu), bytes("01 06 31 00 00 0F C7 32"));
  const uint16_t velocity[] = {0x5555, 0x0008};
  EXPECT_EQ(rtu_frame(1, modbus_pdu::write_registers(0x6F00, velocity).pdu),
            bytes("01 10 6F 00 00 02 04 55 55 00 08 1A 47"));
}

const Bytes kAnswers[] = {
    rtu_frame(3, bytes("03 04 00 01 02 03")),
    rtu_frame(3, bytes("01 01 05")),
    rtu_frame(3, bytes("83 02")),
    rtu_frame(3, bytes("06 31 00 00 0F")),
    rtu_frame(3, bytes("10 99 00 00 09")),
    rtu_frame(3, bytes("08 00 00 12 34")),
};

TEST(RtuFrame, AnAnswerIsCompleteWithItsLastByteAndNotBefore) {
  for (const Bytes& answer : kAnswers) {
    for (size_t size = 0; size < answer.size(); ++size)
      EXPECT_EQ(first_rtu_answer(std::span(answer).first(size)).state, State::kIncomplete) << size;
    Bytes more = answer;
    more.push_back(0x55);
    const RtuAnswer whole = first_rtu_answer(more);
    EXPECT_EQ(whole.state, State::kComplete);
    EXPECT_EQ(whole.length, answer.size());
  }
}

TEST(RtuFrame, NoSingleWrongBitGoesUnnoticed) {
  for (const Bytes& answer : kAnswers) {
    for (size_t bit = 0; bit < 8 * answer.size(); ++bit) {
      Bytes wrong = answer;
      wrong[bit / 8] = static_cast<uint8_t>(wrong[bit / 8] ^ 1u << bit % 8);
      // A longer frame may be announced: then its end is missing.
      EXPECT_NE(first_rtu_answer(wrong).state, State::kComplete) << "bit " << bit;
    }
  }
}

TEST(RtuFrame, NoiseIsNeverAnAnswerButByItsChecksum) {
  std::mt19937 random(3);
  int complete = 0;
  for (int i = 0; i < 20'000; ++i) {
    Bytes noise(random() % 40);
    for (uint8_t& byte : noise) byte = static_cast<uint8_t>(random());
    const RtuAnswer first = first_rtu_answer(noise);
    EXPECT_LE(first.length, noise.size());
    complete += first.state == State::kComplete;
  }
  EXPECT_LE(complete, 5) << "one in 65536 of what has a possible length";
}

}  // namespace
}  // namespace gantry
