#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"

namespace gantry {

/// Requests and answers as the Modbus Application Protocol V1.1b3 has them: function code and data, without
/// the frame that TCP or a serial line puts around them.
namespace modbus_pdu {

using Bytes = std::vector<uint8_t>;

inline constexpr uint8_t kReadCoils = 0x01, kReadDiscreteInputs = 0x02, kReadRegisters = 0x03,
                         kReadInputRegisters = 0x04, kWriteCoil = 0x05, kWriteRegister = 0x06,
                         kDiagnostics = 0x08, kWriteRegisters = 0x10;
inline constexpr uint8_t kExceptionFlag = 0x80;
inline constexpr uint8_t kGatewayPathUnavailable = 0x0A, kGatewayTargetSilent = 0x0B;

/// What may be asked for at once (sections 6.1 to 6.12).
inline constexpr int kMaxReadBits = 2000, kMaxReadRegisters = 125, kMaxWriteRegisters = 123;

/// A request, and what the PDU of its proper answer looks like; an exception is the only other one.
struct Request {
  Bytes pdu;
  Bytes answer_begin;  ///< Function code, then byte count or echoed fields.
  size_t answer_size;
};

Request read_bits(uint8_t function, uint16_t first, uint16_t count);
Request read_registers(uint8_t function, uint16_t first, uint16_t count);
Request write_coil(uint16_t coil, bool on);
Request write_register(uint16_t address, uint16_t value);
Request write_registers(uint16_t first, std::span<const uint16_t> values);
/// "Return query data": the answer repeats `data`.
Request echo(uint16_t data);

/// The registers of a checked answer to read_registers().
std::vector<uint16_t> registers_of(const Bytes& answer);
/// The first `count` bits of a checked answer to read_bits().
std::vector<bool> bits_of(const Bytes& answer, size_t count);

/// "read of register 9000h", for messages.
std::string describe(const Bytes& request_pdu);
/// "exception 2, illegal data address".
std::string exception_name(uint8_t code);

/// The answer if it fits the request; an exception fits too. The fault's device is empty.
Result<Bytes> check_answer(const Request& request, std::span<const uint8_t> answer);

inline void append_u16(Bytes& bytes, uint16_t value) {
  bytes.push_back(static_cast<uint8_t>(value >> 8));
  bytes.push_back(static_cast<uint8_t>(value & 0xFF));
}
inline uint16_t u16_at(std::span<const uint8_t> bytes, size_t index) {
  return static_cast<uint16_t>(bytes[index] << 8 | bytes[index + 1]);
}

}  // namespace modbus_pdu
}  // namespace gantry
