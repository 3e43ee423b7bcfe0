#include "modbus/rtu_frame.h"

namespace gantry {

using namespace modbus_pdu;

uint16_t rtu_crc(std::span<const uint8_t> bytes) {
  uint16_t crc = 0xFFFF;
  for (const uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = static_cast<uint16_t>(crc & 1 ? crc >> 1 ^ 0xA001 : crc >> 1);
  }
  return crc;
}

Bytes rtu_frame(int unit, std::span<const uint8_t> pdu) {
  Bytes frame;
  frame.reserve(pdu.size() + 3);
  frame.push_back(static_cast<uint8_t>(unit));
  for (const uint8_t byte : pdu) frame.push_back(byte);
  const uint16_t crc = rtu_crc(frame);
  frame.push_back(static_cast<uint8_t>(crc & 0xFF));
  frame.push_back(static_cast<uint8_t>(crc >> 8));
  return frame;
}

RtuAnswer first_rtu_answer(std::span<const uint8_t> received) {
  constexpr size_t kCrcBytes = 2;
  constexpr RtuAnswer kDamaged{RtuAnswer::State::kDamaged, 0};
  if (received.size() < 3) return {};
  size_t length = 0;
  if (received[1] & kExceptionFlag) {
    length = 3 + kCrcBytes;
  } else {
    switch (received[1]) {
      case kReadCoils:
      case kReadDiscreteInputs:
      case kReadRegisters:
      case kReadInputRegisters:
        if (received[2] == 0 || received[2] > 2 * kMaxReadRegisters) return kDamaged;
        length = 3u + received[2] + kCrcBytes;
        break;
      case kWriteCoil:
      case kWriteRegister:
      case kDiagnostics:
      case kWriteRegisters:
        length = 6 + kCrcBytes;
        break;
      default:
        return kDamaged;
    }
  }
  if (received.size() < length) return {};
  const uint16_t crc = rtu_crc(received.first(length - kCrcBytes));
  if (received[length - 2] != (crc & 0xFF) || received[length - 1] != crc >> 8) return kDamaged;
  return {RtuAnswer::State::kComplete, length};
}

}  // namespace gantry
