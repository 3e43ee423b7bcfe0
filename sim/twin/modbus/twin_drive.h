#pragma once

#include <cstdint>
#include <span>
#include <tl/expected.hpp>
#include <vector>

namespace gantry {

/// Exception codes of the Modbus Application Protocol V1.1b3, section 7.
enum class ModbusException : uint8_t {
  kIllegalFunction = 0x01,
  kIllegalAddress = 0x02,
  kIllegalValue = 0x03,
  kDeviceFailure = 0x04,
  kBusy = 0x06,
  kGatewayTargetSilent = 0x0B
};

template <typename T>
using ModbusAnswer = tl::expected<T, ModbusException>;

/// One drive as Modbus sees it: addresses, words and bits, plus the hooks for fault injection. Quantities
/// have been checked when a call arrives; whether the addresses exist is for the drive to say. A call
/// that returns an exception has changed nothing. Not thread-safe.
class TwinDrive {
 public:
  virtual ~TwinDrive() = default;

  virtual bool serves(int function) const = 0;
  virtual ModbusAnswer<std::vector<uint16_t>> read_registers(int address, int count, double now_s) = 0;
  virtual ModbusAnswer<std::vector<uint8_t>> read_bits(int address, int count, double now_s) = 0;
  virtual ModbusAnswer<void> write_bit(int address, bool on, double now_s) = 0;
  virtual ModbusAnswer<void> write_registers(int address, std::span<const uint16_t> words, double now_s) = 0;

  /// A request has come, whatever becomes of it: what a communication time-out waits for.
  virtual void heard(double /*now_s*/) {}

  virtual void raise_alarm(int code, bool persists, double now_s) = 0;
  virtual void clear_alarm_cause() = 0;
  virtual void set_emergency_stop(bool active, double now_s) = 0;
};

/// As IAI, Oriental Motor and Leadshine order them: upper word at the lower address.
inline int32_t int32_from_words(uint16_t upper, uint16_t lower) {
  return static_cast<int32_t>(static_cast<uint32_t>(upper) << 16 | lower);
}
inline uint16_t upper_word(int32_t value) {
  return static_cast<uint16_t>(static_cast<uint32_t>(value) >> 16);
}
inline uint16_t lower_word(int32_t value) {
  return static_cast<uint16_t>(static_cast<uint32_t>(value));
}

}  // namespace gantry
