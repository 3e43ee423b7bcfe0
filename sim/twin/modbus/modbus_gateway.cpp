#include "modbus_gateway.h"

#include <algorithm>

namespace gantry {
namespace {

// MBAP header: transaction 2 bytes, protocol 2, length 2 (unit and PDU), unit 1; then the PDU.
constexpr size_t kLengthEnd = 6;
constexpr size_t kUnitOffset = 6;
constexpr size_t kPduOffset = 7;
constexpr int kMaxReadRegisters = 125;
constexpr int kMaxWriteRegisters = 123;
constexpr int kMaxReadBits = 2000;

int word_at(std::span<const uint8_t> bytes, size_t offset) {
  return bytes[offset] << 8 | bytes[offset + 1];
}

using Mapping = std::unique_ptr<modbus_mapping_t, decltype(&modbus_mapping_free)>;

/// The part of the address space that one request is about, for libmodbus to build the reply from.
struct Reply {
  Mapping mapping{nullptr, &modbus_mapping_free};

  static Reply bits(int address, const std::vector<uint8_t>& values) {
    const auto a = static_cast<unsigned>(address);
    const auto n = static_cast<unsigned>(values.size());
    Reply reply{{modbus_mapping_new_start_address(a, n, a, n, 0, 0, 0, 0), &modbus_mapping_free}};
    if (reply.mapping) {
      std::copy(values.begin(), values.end(), reply.mapping->tab_bits);
      std::copy(values.begin(), values.end(), reply.mapping->tab_input_bits);
    }
    return reply;
  }
  static Reply registers(int address, const std::vector<uint16_t>& values) {
    const auto a = static_cast<unsigned>(address);
    const auto n = static_cast<unsigned>(values.size());
    Reply reply{{modbus_mapping_new_start_address(0, 0, 0, 0, a, n, 0, 0), &modbus_mapping_free}};
    if (reply.mapping) std::copy(values.begin(), values.end(), reply.mapping->tab_registers);
    return reply;
  }
};

ModbusAnswer<Reply> act(TwinDrive& drive, std::span<const uint8_t> pdu, double now_s) {
  const int function = pdu[0];
  if (!drive.serves(function)) return tl::make_unexpected(ModbusException::kIllegalFunction);
  const auto illegal_value = tl::make_unexpected(ModbusException::kIllegalValue);
  if (pdu.size() < 5 || (function != MODBUS_FC_WRITE_MULTIPLE_REGISTERS && pdu.size() != 5))
    return illegal_value;
  const int address = word_at(pdu, 1);
  const int value = word_at(pdu, 3);  // or the quantity
  switch (function) {
    case MODBUS_FC_READ_COILS:
    case MODBUS_FC_READ_DISCRETE_INPUTS:
      if (value < 1 || value > kMaxReadBits) return illegal_value;
      return drive.read_bits(address, value, now_s).map([&](const auto& bits) {
        return Reply::bits(address, bits);
      });
    case MODBUS_FC_READ_HOLDING_REGISTERS:
      if (value < 1 || value > kMaxReadRegisters) return illegal_value;
      return drive.read_registers(address, value, now_s).map([&](const auto& words) {
        return Reply::registers(address, words);
      });
    case MODBUS_FC_WRITE_SINGLE_COIL:
      if (value != 0xFF00 && value != 0x0000) return illegal_value;
      return drive.write_bit(address, value != 0, now_s).map([&] { return Reply::bits(address, {0}); });
    case MODBUS_FC_WRITE_SINGLE_REGISTER: {
      const uint16_t word = static_cast<uint16_t>(value);
      return drive.write_registers(address, {&word, 1}, now_s).map([&] {
        return Reply::registers(address, {word});
      });
    }
    default: {  // MODBUS_FC_WRITE_MULTIPLE_REGISTERS
      const size_t data_bytes = 2 * static_cast<size_t>(value);
      if (value < 1 || value > kMaxWriteRegisters || pdu.size() != 6 + data_bytes || pdu[5] != data_bytes)
        return illegal_value;
      std::vector<uint16_t> words;
      for (size_t i = 6; i < pdu.size(); i += 2) words.push_back(static_cast<uint16_t>(word_at(pdu, i)));
      return drive.write_registers(address, words, now_s).map([&] {
        return Reply::registers(address, words);
      });
    }
  }
}

}  // namespace

ModbusFrame first_modbus_frame(std::span<const uint8_t> received) {
  if (received.size() < kLengthEnd) return {};
  const int protocol = word_at(received, 2);
  const int length = word_at(received, 4);
  const size_t total = kLengthEnd + static_cast<size_t>(length);
  if (protocol != 0 || length < 2 || total > MODBUS_TCP_MAX_ADU_LENGTH)
    return {ModbusFrame::State::kNotModbus, 0};
  if (received.size() < total) return {};
  return {ModbusFrame::State::kComplete, total};
}

bool answer_modbus_request(modbus_t* context, std::span<const uint8_t> frame, TwinDrives& drives,
                           double now_s) {
  const auto drive = drives.find(frame[kUnitOffset]);
  const auto reply = drive == drives.end()
                         ? ModbusAnswer<Reply>(tl::make_unexpected(ModbusException::kGatewayTargetSilent))
                         : act(*drive->second, frame.subspan(kPduOffset), now_s);
  if (!reply) return modbus_reply_exception(context, frame.data(), static_cast<unsigned>(reply.error())) > 0;
  return reply->mapping &&
         modbus_reply(context, frame.data(), static_cast<int>(frame.size()), reply->mapping.get()) > 0;
}

}  // namespace gantry
