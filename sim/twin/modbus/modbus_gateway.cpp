#include "modbus_gateway.h"

#include <array>

namespace gantry {
namespace {

constexpr int kReadCoils = 0x01, kReadInputs = 0x02, kReadRegisters = 0x03, kWriteCoil = 0x05,
              kWriteRegister = 0x06, kDiagnostics = 0x08, kWriteCoils = 0x0F, kWriteRegisters = 0x10;
constexpr int kMaxReadRegisters = 125;
constexpr int kMaxWriteRegisters = 123;
constexpr int kMaxReadBits = 2000;

// MBAP header: transaction 2 bytes, protocol 2, length 2 (unit and PDU), unit 1; then the PDU.
constexpr size_t kLengthEnd = 6;
constexpr size_t kMaxTcpFrame = 260;

int word_at(std::span<const uint8_t> bytes, size_t offset) {
  return bytes[offset] << 8 | bytes[offset + 1];
}

void put_word(std::vector<uint8_t>& bytes, int word) {
  bytes.push_back(static_cast<uint8_t>(word >> 8));
  bytes.push_back(static_cast<uint8_t>(word & 0xFF));
}

/// CRC-16 of the serial line specification, appendix B: by table, reflected polynomial A001.
std::array<uint16_t, 256> make_crc_table() {
  std::array<uint16_t, 256> table{};
  for (unsigned index = 0; index < 256; ++index) {
    unsigned value = index;
    for (int i = 0; i < 8; ++i) value = (value >> 1) ^ ((value & 1u) * 0xA001u);
    table[index] = static_cast<uint16_t>(value);
  }
  return table;
}

uint16_t checksum(std::span<const uint8_t> bytes) {
  static const std::array<uint16_t, 256> table = make_crc_table();
  uint16_t sum = 0xFFFF;
  for (const uint8_t byte : bytes) sum = static_cast<uint16_t>(sum >> 8 ^ table[(sum ^ byte) & 0xFF]);
  return sum;
}

using Reply = ModbusAnswer<std::vector<uint8_t>>;

Reply act(TwinDrive& drive, std::span<const uint8_t> pdu, double now_s) {
  const int function = pdu[0];
  if (!drive.serves(function)) return tl::make_unexpected(ModbusException::kIllegalFunction);
  const auto illegal_value = tl::make_unexpected(ModbusException::kIllegalValue);
  if (pdu.size() < 5 || (function != kWriteRegisters && pdu.size() != 5)) return illegal_value;
  const int address = word_at(pdu, 1);
  const int value = word_at(pdu, 3);  // or the quantity
  const std::vector<uint8_t> echo(pdu.begin(), pdu.begin() + 5);
  switch (function) {
    case kReadCoils:
    case kReadInputs:
      if (value < 1 || value > kMaxReadBits) return illegal_value;
      return drive.read_bits(address, value, now_s).map([&](const std::vector<uint8_t>& bits) {
        std::vector<uint8_t> reply{pdu[0], static_cast<uint8_t>((bits.size() + 7) / 8)};
        reply.resize(2 + reply[1], 0);
        for (size_t i = 0; i < bits.size(); ++i)
          reply[2 + i / 8] = static_cast<uint8_t>(reply[2 + i / 8] | (bits[i] ? 1u << i % 8 : 0u));
        return reply;
      });
    case kReadRegisters:
      if (value < 1 || value > kMaxReadRegisters) return illegal_value;
      return drive.read_registers(address, value, now_s).map([&](const std::vector<uint16_t>& words) {
        std::vector<uint8_t> reply{pdu[0], static_cast<uint8_t>(2 * words.size())};
        for (const uint16_t word : words) put_word(reply, word);
        return reply;
      });
    case kWriteCoil:
      if (value != 0xFF00 && value != 0x0000) return illegal_value;
      return drive.write_bit(address, value != 0, now_s).map([&] { return echo; });
    case kWriteRegister: {
      const uint16_t word = static_cast<uint16_t>(value);
      return drive.write_registers(address, {&word, 1}, now_s).map([&] { return echo; });
    }
    case kDiagnostics:
      if (address != 0) return illegal_value;  // sub-function 0: return query data
      return echo;
    default: {  // kWriteRegisters
      const size_t data_bytes = 2 * static_cast<size_t>(value);
      if (value < 1 || value > kMaxWriteRegisters || pdu.size() != 6 + data_bytes || pdu[5] != data_bytes)
        return illegal_value;
      std::vector<uint16_t> words;
      for (size_t i = 6; i < pdu.size(); i += 2) words.push_back(static_cast<uint16_t>(word_at(pdu, i)));
      return drive.write_registers(address, words, now_s).map([&] { return echo; });
    }
  }
}

}  // namespace

ModbusFrame first_tcp_request(std::span<const uint8_t> received) {
  if (received.size() < kLengthEnd) return {};
  const int protocol = word_at(received, 2);
  const int length = word_at(received, 4);
  const size_t total = kLengthEnd + static_cast<size_t>(length);
  if (protocol != 0 || length < 2 || total > kMaxTcpFrame) return {ModbusFrame::State::kNotModbus, 0};
  if (received.size() < total) return {};
  return {ModbusFrame::State::kComplete, total};
}

ModbusFrame first_rtu_request(std::span<const uint8_t> received) {
  if (received.size() < 2) return {};
  const int function = received[1];
  size_t total = 8;
  if (function == kWriteCoils || function == kWriteRegisters) {
    if (received.size() < 7) return {};
    total = 9u + received[6];
  } else if (function < kReadCoils || function > kDiagnostics || function == 0x07) {
    return {ModbusFrame::State::kNotModbus, 0};
  }
  if (received.size() < total) return {};
  const uint16_t sum = checksum(received.first(total - 2));
  if (received[total - 2] != (sum & 0xFF) || received[total - 1] != sum >> 8)
    return {ModbusFrame::State::kNotModbus, 0};
  return {ModbusFrame::State::kComplete, total};
}

std::vector<uint8_t> exception_reply(uint8_t function, ModbusException code) {
  return {static_cast<uint8_t>(function | 0x80), static_cast<uint8_t>(code)};
}

std::vector<uint8_t> answer_request(TwinDrive& drive, std::span<const uint8_t> pdu, double now_s) {
  drive.heard(now_s);
  Reply reply = act(drive, pdu, now_s);
  return reply ? std::move(*reply) : exception_reply(pdu[0], reply.error());
}

std::vector<uint8_t> tcp_reply(std::span<const uint8_t> request, std::span<const uint8_t> pdu) {
  std::vector<uint8_t> frame(request.begin(), request.begin() + 4);
  put_word(frame, static_cast<int>(pdu.size()) + 1);
  frame.push_back(request[6]);
  frame.insert(frame.end(), pdu.begin(), pdu.end());
  return frame;
}

std::vector<uint8_t> rtu_reply(std::span<const uint8_t> request, std::span<const uint8_t> pdu) {
  std::vector<uint8_t> frame;
  frame.reserve(pdu.size() + 3);
  frame.push_back(request[0]);
  for (const uint8_t byte : pdu) frame.push_back(byte);
  const uint16_t sum = checksum(frame);
  frame.push_back(static_cast<uint8_t>(sum & 0xFF));
  frame.push_back(static_cast<uint8_t>(sum >> 8));
  return frame;
}

}  // namespace gantry
