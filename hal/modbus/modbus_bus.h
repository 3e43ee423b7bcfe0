#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"
#include "gantry/hal/bus_statistics.h"
#include "modbus/modbus_link.h"
#include "modbus/turn_queue.h"

namespace gantry {

/// How the bus may treat a write.
struct WriteHandling {
  bool urgent = false;  ///< Goes before everything that waits: a halt, torque off.
  /// Doing it twice does the same as doing it once, so it may be sent again when its answer is lost. Never
  /// for what starts a motion, nor for half of an edge.
  bool repeatable = false;
};

/// One Modbus bus with its units: a TCP connection to a drive or gateway, or a serial line. Thread-safe and
/// blocking: callers queue (TurnQueue), one exchange at a time, in whole. What the link behind it guarantees
/// is said in ModbusLink; the bus adds:
///
/// - `timeout_s` is one deadline for everything, repetitions included. It starts when it is the caller's
/// turn,
///   so a silent unit costs its neighbours a delay and no fault.
/// - Reads, and writes that are named repeatable, are sent up to `attempts` times; all else once: it might
/// move
///   something twice.
///
/// Faults carry an empty device: the caller knows whom it addressed.
class ModbusBus {
 public:
  ModbusBus(std::unique_ptr<ModbusLink> link, int attempts);

  /// "127.0.0.1:1503" or "/dev/ttyUSB0".
  std::string address() const { return link_->address(); }
  int attempts() const { return attempts_; }

  /// FC01.
  Result<std::vector<bool>> read_coils(int unit, uint16_t first, uint16_t count, double timeout_s);
  /// FC02.
  Result<std::vector<bool>> read_discrete_inputs(int unit, uint16_t first, uint16_t count, double timeout_s);
  /// FC03.
  Result<std::vector<uint16_t>> read_registers(int unit, uint16_t first, uint16_t count, double timeout_s);
  /// FC04.
  Result<std::vector<uint16_t>> read_input_registers(int unit, uint16_t first, uint16_t count,
                                                     double timeout_s);
  /// FC05.
  Result<void> write_coil(int unit, uint16_t coil, bool on, double timeout_s, WriteHandling handling = {});
  /// FC06.
  Result<void> write_register(int unit, uint16_t address, uint16_t value, double timeout_s,
                              WriteHandling handling = {});
  /// FC10.
  Result<void> write_registers(int unit, uint16_t first, std::span<const uint16_t> values, double timeout_s,
                               WriteHandling handling = {});

  BusStatistics statistics() const;

 private:
  /// Returns the PDU of the proper answer.
  Result<modbus_pdu::Bytes> transact(int unit, const modbus_pdu::Request& request, double timeout_s,
                                     WriteHandling handling);
  Result<modbus_pdu::Bytes> exchange_once(int unit, const modbus_pdu::Request& request, double deadline_s,
                                          bool retry);
  Result<void> write(int unit, const modbus_pdu::Request& request, double timeout_s, WriteHandling handling);
  void count(const Result<modbus_pdu::Bytes>& answer, double duration_us, bool retry);

  const std::unique_ptr<ModbusLink> link_;  ///< Of whoever has the turn.
  const int attempts_;
  TurnQueue turns_;
  mutable std::mutex statistics_mutex_;
  BusStatistics statistics_;
  RoundTripHistogram round_trips_;
};

}  // namespace gantry
