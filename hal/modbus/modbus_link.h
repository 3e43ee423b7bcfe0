#pragma once

#include <cmath>
#include <string>

#include "gantry/foundation/clock.h"
#include "modbus/modbus_pdu.h"

namespace gantry {

/// What carries Modbus requests to the units of one bus: a TCP connection or a serial line. One exchange at a
/// time; ModbusBus sees to that.
///
/// Rules that every link keeps:
/// - `deadline_s`, by wire_time_s(), is one deadline for everything: opening, sending, the last byte of the
///   answer.
/// - An answer counts only if it is the answer to this very request: a late or a repeated one never does.
/// - What has failed needs no restart: the next exchange opens the link again.
/// - A request is sent at most once.
class ModbusLink {
 public:
  virtual ~ModbusLink() = default;

  /// "127.0.0.1:1503" or "/dev/ttyUSB0".
  virtual std::string address() const = 0;
  /// The PDU of the answer: the proper one or an exception.
  virtual Result<modbus_pdu::Bytes> exchange(int unit, const modbus_pdu::Request& request,
                                             double deadline_s) = 0;
  /// How often it has been opened.
  virtual int openings() const = 0;
  /// Answers that belonged to no request under way, and were thrown away.
  virtual int strays() const = 0;
};

/// The wire runs in real time whatever the clock of the cell is.
inline double wire_time_s() {
  return SteadyClock().now_s();
}

namespace modbus_faults {

inline tl::unexpected<Fault> no_answer(const modbus_pdu::Request& request, int unit, double waited_s) {
  return fault(FaultKind::kTimeout, {},
               "no complete answer to the " + modbus_pdu::describe(request.pdu) + " within " +
                   std::to_string(std::lround(waited_s * 1e3)) + " ms; is unit " + std::to_string(unit) +
                   " powered and its cable in place?");
}

}  // namespace modbus_faults
}  // namespace gantry
