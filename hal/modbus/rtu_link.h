#pragma once

#include <map>

#include "modbus/modbus_link.h"
#include "modbus/serial_port.h"

namespace gantry {

/// Modbus RTU on a serial line with any number of units (Modbus over Serial Line V1.02). Own framing and not
/// libmodbus's, because an RTU frame has no number that says which request it answers: a late answer fits the
/// next read of the same size, and libmodbus hands it out as that.
///
/// How a late answer is told:
/// - Before every request the line has been quiet for 3.5 characters; what arrived unasked is thrown away.
///   Answers of other units, functions or sizes are passed over while waiting.
/// - A unit that owes an answer is first asked to repeat a number (function 08, "return query data"). Units
///   answer in the order in which they were asked, so whatever it still had to say comes before that, and its
///   answer, also if it is the exception "illegal function", fits no other request.
/// - A unit that is silent to that is asked nothing else until `late_answer_s` after the request that it owes
///   an answer to: a bound that the line's owner states.
class RtuLink final : public ModbusLink {
 public:
  explicit RtuLink(SerialLine line);

  std::string address() const override { return port_.line().device; }
  Result<modbus_pdu::Bytes> exchange(int unit, const modbus_pdu::Request& request,
                                     double deadline_s) override;
  int openings() const override { return openings_; }
  int strays() const override { return strays_; }

 private:
  /// A unit that owes an answer.
  struct Owed {
    double since_s = 0;       ///< When it was asked.
    uint16_t last_check = 0;  ///< The last line check before that.
  };

  Result<void> send(int unit, const modbus_pdu::Request& request, double deadline_s);
  Result<modbus_pdu::Bytes> await_answer(int unit, const modbus_pdu::Request& request, double deadline_s);
  Result<void> settle(int unit, double deadline_s);
  Result<void> await_silence(double deadline_s);

  SerialPort port_;
  const double character_s_;
  const double silence_s_;    ///< Between two frames: 3.5 characters, 1.75 ms from 19200 baud on.
  std::map<int, Owed> owed_;  ///< By unit.
  double quiet_since_s_ = 0;  ///< When the last byte, ours or theirs, was off the line.
  uint16_t last_check_ = 0;   ///< Each line check has a number of its own.
  int openings_ = 0;
  int strays_ = 0;
};

}  // namespace gantry
