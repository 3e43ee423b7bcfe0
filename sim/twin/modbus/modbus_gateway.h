#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "twin_drive.h"

namespace gantry {

using TwinDrives = std::map<int, std::unique_ptr<TwinDrive>>;  ///< By Modbus unit.

/// What the bytes received so far begin with.
struct ModbusFrame {
  enum class State { kIncomplete, kComplete, kNotModbus };
  State state = State::kIncomplete;
  size_t length = 0;  ///< Of the whole frame, when complete.
};

/// A request on TCP, by the MBAP header's own length field.
ModbusFrame first_tcp_request(std::span<const uint8_t> received);
/// A request on a serial line, by its function code; kNotModbus where checksum or function are none of ours:
/// then only silence finds the next one.
ModbusFrame first_rtu_request(std::span<const uint8_t> received);

/// Lets the drive act on a request PDU (at least a function code), and returns the PDU of its reply, which
/// may be an exception.
std::vector<uint8_t> answer_request(TwinDrive& drive, std::span<const uint8_t> pdu, double now_s);
std::vector<uint8_t> exception_reply(uint8_t function, ModbusException code);

/// The reply as it travels. `request` is the whole request frame.
std::vector<uint8_t> tcp_reply(std::span<const uint8_t> request, std::span<const uint8_t> pdu);
std::vector<uint8_t> rtu_reply(std::span<const uint8_t> request, std::span<const uint8_t> pdu);

}  // namespace gantry
