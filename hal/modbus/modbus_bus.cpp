#include "modbus/modbus_bus.h"

#include <algorithm>
#include <utility>

namespace gantry {

using modbus_pdu::Bytes;
using modbus_pdu::Request;

namespace {

constexpr WriteHandling kRead{.urgent = false, .repeatable = true};

}  // namespace

ModbusBus::ModbusBus(std::unique_ptr<ModbusLink> link, int attempts)
    : link_(std::move(link)), attempts_(std::max(attempts, 1)) {}

Result<Bytes> ModbusBus::transact(int unit, const Request& request, double timeout_s,
                                  WriteHandling handling) {
  const auto turn = turns_.take(unit, handling.urgent);
  const double deadline_s = wire_time_s() + timeout_s;
  const int attempts = handling.repeatable ? attempts_ : 1;
  Result<Bytes> answer;
  for (int attempt = 1; attempt <= attempts; ++attempt) {
    // Each attempt may use an equal share of the time that is left.
    const double now_s = wire_time_s();
    if (attempt > 1 && now_s >= deadline_s) break;
    answer =
        exchange_once(unit, request, now_s + (deadline_s - now_s) / (attempts - attempt + 1), attempt > 1);
    if (answer) break;
  }
  if (!answer || (answer->front() & modbus_pdu::kExceptionFlag) == 0) return answer;

  const uint8_t code = answer->back();
  const std::string exception = "(" + modbus_pdu::exception_name(code) + ")";
  if (code == modbus_pdu::kGatewayPathUnavailable || code == modbus_pdu::kGatewayTargetSilent)
    return fault(FaultKind::kUnreachable, {},
                 "the gateway reaches no unit " + std::to_string(unit) + " " + exception +
                     "; is the device powered and its unit in CELL.yaml right?");
  return fault(FaultKind::kRefused, {},
               "the device refused the " + modbus_pdu::describe(request.pdu) + " " + exception);
}

Result<Bytes> ModbusBus::exchange_once(int unit, const Request& request, double deadline_s, bool retry) {
  const double begin_s = wire_time_s();
  auto answer = link_->exchange(unit, request, deadline_s);
  count(answer, (wire_time_s() - begin_s) * 1e6, retry);
  return answer;
}

void ModbusBus::count(const Result<Bytes>& answer, double duration_us, bool retry) {
  std::lock_guard lock(statistics_mutex_);
  BusStatistics& s = statistics_;
  ++s.requests;
  if (retry) ++s.retries;
  s.reconnects = std::max(0, link_->openings() - 1);
  s.strays = link_->strays();
  if (answer) {
    if ((answer->front() & modbus_pdu::kExceptionFlag) != 0) {
      ++s.exceptions;
      s.last_error = modbus_pdu::exception_name(answer->back());
    }
    round_trips_.add(duration_us);
    return;
  }
  const Fault& fault = answer.error();
  (fault.kind == FaultKind::kTimeout       ? s.timeouts
   : fault.kind == FaultKind::kUnreachable ? s.unreachable
                                           : s.wrong_answers)++;
  s.last_error = fault.message;
}

BusStatistics ModbusBus::statistics() const {
  std::lock_guard lock(statistics_mutex_);
  BusStatistics s = statistics_;
  s.round_trips = round_trips_.count();
  s.round_trip_min_us = round_trips_.min_us();
  s.round_trip_median_us = round_trips_.quantile_us(0.5);
  s.round_trip_p99_us = round_trips_.quantile_us(0.99);
  s.round_trip_max_us = round_trips_.max_us();
  return s;
}

Result<std::vector<bool>> ModbusBus::read_coils(int unit, uint16_t first, uint16_t count, double timeout_s) {
  return transact(unit, modbus_pdu::read_bits(modbus_pdu::kReadCoils, first, count), timeout_s, kRead)
      .map([count](const Bytes& answer) { return modbus_pdu::bits_of(answer, count); });
}

Result<std::vector<bool>> ModbusBus::read_discrete_inputs(int unit, uint16_t first, uint16_t count,
                                                          double timeout_s) {
  return transact(unit, modbus_pdu::read_bits(modbus_pdu::kReadDiscreteInputs, first, count), timeout_s,
                  kRead)
      .map([count](const Bytes& answer) { return modbus_pdu::bits_of(answer, count); });
}

Result<std::vector<uint16_t>> ModbusBus::read_registers(int unit, uint16_t first, uint16_t count,
                                                        double timeout_s) {
  return transact(unit, modbus_pdu::read_registers(modbus_pdu::kReadRegisters, first, count), timeout_s,
                  kRead)
      .map(modbus_pdu::registers_of);
}

Result<std::vector<uint16_t>> ModbusBus::read_input_registers(int unit, uint16_t first, uint16_t count,
                                                              double timeout_s) {
  return transact(unit, modbus_pdu::read_registers(modbus_pdu::kReadInputRegisters, first, count), timeout_s,
                  kRead)
      .map(modbus_pdu::registers_of);
}

Result<void> ModbusBus::write(int unit, const Request& request, double timeout_s, WriteHandling handling) {
  const auto answer = transact(unit, request, timeout_s, handling);
  if (!answer) return tl::make_unexpected(answer.error());
  return {};
}

Result<void> ModbusBus::write_coil(int unit, uint16_t coil, bool on, double timeout_s,
                                   WriteHandling handling) {
  return write(unit, modbus_pdu::write_coil(coil, on), timeout_s, handling);
}

Result<void> ModbusBus::write_register(int unit, uint16_t address, uint16_t value, double timeout_s,
                                       WriteHandling handling) {
  return write(unit, modbus_pdu::write_register(address, value), timeout_s, handling);
}

Result<void> ModbusBus::write_registers(int unit, uint16_t first, std::span<const uint16_t> values,
                                        double timeout_s, WriteHandling handling) {
  return write(unit, modbus_pdu::write_registers(first, values), timeout_s, handling);
}

}  // namespace gantry
