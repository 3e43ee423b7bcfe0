#include "modbus/modbus_pdu.h"

#include <algorithm>
#include <cstdio>

namespace gantry::modbus_pdu {
namespace {

Request read(uint8_t function, uint16_t first, uint16_t count, size_t data_bytes) {
  Bytes pdu{function};
  append_u16(pdu, first);
  append_u16(pdu, count);
  return {std::move(pdu), {function, static_cast<uint8_t>(data_bytes)}, 2 + data_bytes};
}

Request echoed(Bytes pdu) {
  const size_t size = pdu.size();
  return {pdu, pdu, size};
}

}  // namespace

Request read_bits(uint8_t function, uint16_t first, uint16_t count) {
  return read(function, first, count, (count + 7u) / 8u);
}

Request read_registers(uint8_t function, uint16_t first, uint16_t count) {
  return read(function, first, count, 2u * count);
}

Request write_coil(uint16_t coil, bool on) {
  Bytes pdu{kWriteCoil};
  append_u16(pdu, coil);
  append_u16(pdu, on ? 0xFF00 : 0x0000);
  return echoed(std::move(pdu));
}

Request write_register(uint16_t address, uint16_t value) {
  Bytes pdu{kWriteRegister};
  append_u16(pdu, address);
  append_u16(pdu, value);
  return echoed(std::move(pdu));
}

Request write_registers(uint16_t first, std::span<const uint16_t> values) {
  Bytes pdu{kWriteRegisters};
  append_u16(pdu, first);
  append_u16(pdu, static_cast<uint16_t>(values.size()));
  const Bytes echo = pdu;
  pdu.push_back(static_cast<uint8_t>(2 * values.size()));
  for (const uint16_t value : values) append_u16(pdu, value);
  return {std::move(pdu), echo, echo.size()};
}

Request echo(uint16_t data) {
  Bytes pdu{kDiagnostics, 0, 0};
  append_u16(pdu, data);
  return echoed(std::move(pdu));
}

std::vector<uint16_t> registers_of(const Bytes& answer) {
  std::vector<uint16_t> registers;
  for (size_t i = 2; i + 1 < answer.size(); i += 2) registers.push_back(u16_at(answer, i));
  return registers;
}

std::vector<bool> bits_of(const Bytes& answer, size_t count) {
  std::vector<bool> bits;
  for (size_t i = 0; i < count; ++i) bits.push_back((answer[2 + i / 8] >> i % 8 & 1) != 0);
  return bits;
}

std::string describe(const Bytes& request_pdu) {
  const auto what = [function = request_pdu[0]]() -> const char* {
    switch (function) {
      case kReadCoils:
        return "read of coil";
      case kReadDiscreteInputs:
        return "read of discrete input";
      case kReadRegisters:
        return "read of register";
      case kReadInputRegisters:
        return "read of input register";
      case kWriteCoil:
        return "write to coil";
      case kDiagnostics:
        return "line check";
      default:
        return "write to register";
    }
  };
  char text[48];
  std::snprintf(text, sizeof text, "%s %04Xh", what(), u16_at(request_pdu, 1));
  return text;
}

std::string exception_name(uint8_t code) {
  const auto name = [code]() -> const char* {
    switch (code) {
      case 0x01:
        return "illegal function";
      case 0x02:
        return "illegal data address";
      case 0x03:
        return "illegal data value";
      case 0x04:
        return "device failure";
      case 0x05:
        return "acknowledge";
      case 0x06:
        return "device busy";
      case 0x08:
        return "memory parity or checksum error";
      case kGatewayPathUnavailable:
        return "gateway path unavailable";
      case kGatewayTargetSilent:
        return "gateway target does not respond";
      default:
        return "unknown code";
    }
  };
  return "exception " + std::to_string(code) + ", " + name();
}

Result<Bytes> check_answer(const Request& request, std::span<const uint8_t> answer) {
  const auto wrong = [&request](const char* field, size_t found, size_t wanted) {
    return fault(FaultKind::kProtocol, {},
                 "wrong answer to the " + describe(request.pdu) + ": " + field + " is " +
                     std::to_string(found) + ", expected " + std::to_string(wanted));
  };
  if (answer.empty()) return wrong("its size", 0, request.answer_size);
  if ((answer[0] & ~kExceptionFlag) != request.pdu[0])
    return wrong("its function code", answer[0], request.pdu[0]);
  const bool exception = (answer[0] & kExceptionFlag) != 0;
  const size_t expected_size = exception ? 2 : request.answer_size;
  if (answer.size() != expected_size) return wrong("its size", answer.size(), expected_size);
  if (!exception) {
    const auto difference =
        std::mismatch(request.answer_begin.begin(), request.answer_begin.end(), answer.begin());
    if (difference.first != request.answer_begin.end())
      return wrong("an echoed byte", *difference.second, *difference.first);
  }
  return Bytes(answer.begin(), answer.end());
}

}  // namespace gantry::modbus_pdu
