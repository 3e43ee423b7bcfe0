#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"

struct _modbus;  // libmodbus calls it modbus_t.

namespace gantry {

/// One Modbus TCP connection to a drive, or to a gateway with several units behind it (Modbus
/// Messaging on TCP/IP Implementation Guide V1.0b). Thread-safe: one exchange at a time, in whole.
///
/// Rules that every operation keeps:
/// - `timeout_s` is one deadline for everything: reopening the connection, sending, the last byte of
///   the answer. It starts when the bus is free, so a silent unit costs its neighbours a delay and
///   no fault.
/// - An answer counts only if transaction, unit, function, length and echoed fields are those of the
///   request. libmodbus does not compare the unit on TCP, so requests are framed and answers checked
///   here; libmodbus connects, receives and keeps the time.
/// - After a timeout or a wrong answer the connection is closed: a late answer dies with it and can
///   never be taken for the answer to another request. The next operation opens a new one, so a drive
///   that comes back needs no restart.
/// - A request that may have been sent is never repeated: it might move something twice.
///
/// Faults carry an empty device: the caller knows whom it addressed.
class ModbusBus {
 public:
  ModbusBus(std::string host, int port);
  ~ModbusBus();
  ModbusBus(const ModbusBus&) = delete;
  ModbusBus& operator=(const ModbusBus&) = delete;

  /// "127.0.0.1:1503".
  std::string address() const;

  /// FC02.
  Result<std::vector<bool>> read_discrete_inputs(int unit, uint16_t first, uint16_t count, double timeout_s);
  /// FC03.
  Result<std::vector<uint16_t>> read_registers(int unit, uint16_t first, uint16_t count, double timeout_s);
  /// FC10.
  Result<void> write_registers(int unit, uint16_t first, std::span<const uint16_t> values, double timeout_s);
  /// FC05.
  Result<void> write_coil(int unit, uint16_t coil, bool on, double timeout_s);

 private:
  using Bytes = std::vector<uint8_t>;
  struct ContextDeleter {
    void operator()(_modbus* context) const;
  };

  /// What the PDU of a proper answer looks like; an exception is the only other one.
  struct Expected {
    Bytes begin;  ///< Function code, then byte count or echoed fields.
    size_t size;
  };

  /// Sends the request PDU and returns the PDU of the proper answer.
  Result<Bytes> transact(int unit, const Bytes& request, const Expected& expected, double timeout_s);
  Result<Bytes> exchange(int unit, const Bytes& request, const Expected& expected, double deadline_s,
                         double timeout_s);
  /// The PDU of an answer that fits the request; an exception answer fits too.
  Result<Bytes> check(std::span<const uint8_t> answer, int unit, const Bytes& request,
                      const Expected& expected) const;
  Result<void> open(double deadline_s);
  bool connection_is_clean() const;
  bool limit_waiting_until(double deadline_s);
  void close();

  const std::string host_;
  const int port_;
  std::mutex mutex_;
  std::unique_ptr<_modbus, ContextDeleter> context_;  ///< Null while there is no connection.
  uint16_t transaction_ = 0;
};

}  // namespace gantry
