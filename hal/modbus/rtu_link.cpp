#include "modbus/rtu_link.h"

#include <algorithm>
#include <utility>

#include "modbus/rtu_frame.h"

namespace gantry {

using modbus_pdu::Bytes;
using modbus_pdu::Request;

namespace {

/// A frame whose next byte does not come within this has lost its end. USB adapters hand bytes over every
/// 16 ms.
constexpr double kByteTimeout_s = 0.05;

int bits_per_character(const SerialLine& line) {
  return 1 + 8 + (line.parity == Parity::kNone ? 0 : 1) + line.stop_bits;
}

}  // namespace

RtuLink::RtuLink(SerialLine line)
    : port_(std::move(line)),
      character_s_(static_cast<double>(bits_per_character(port_.line())) / port_.line().baud),
      silence_s_(port_.line().baud > 19200 ? 1.75e-3 : 3.5 * character_s_) {}

// What arrives is thrown away until nothing has arrived for the time between two frames.
Result<void> RtuLink::await_silence(double deadline_s) {
  bool stray = false;
  for (;;) {
    const double quiet_s = quiet_since_s_ + silence_s_;
    Bytes unasked;
    if (auto heard = port_.read(unasked, std::min(quiet_s, deadline_s)); !heard) return heard;
    if (!unasked.empty()) {
      stray = true;
      quiet_since_s_ = wire_time_s();
    }
    const double now_s = wire_time_s();
    if (unasked.empty() && now_s >= quiet_s) break;
    if (now_s >= deadline_s)
      return fault(FaultKind::kTimeout, {}, "serial line " + address() + " is never quiet; who else sends?");
  }
  if (stray) ++strays_;
  return {};
}

Result<Bytes> RtuLink::exchange(int unit, const Request& request, double deadline_s) {
  if (!port_.is_open()) {
    if (auto opened = port_.open(); !opened) return tl::make_unexpected(opened.error());
    ++openings_;
  }
  if (owed_since_s_.contains(unit)) {
    if (auto settled = settle(unit, deadline_s); !settled) return tl::make_unexpected(settled.error());
  }
  auto answer = ask(unit, request, deadline_s);
  if (!answer) owed_since_s_[unit] = wire_time_s();
  return answer;
}

Result<void> RtuLink::settle(int unit, double deadline_s) {
  const double begin_s = wire_time_s();
  const auto repeated = ask(unit, modbus_pdu::echo(++check_), begin_s + (deadline_s - begin_s) / 2);
  const double silent_for_s = wire_time_s() - owed_since_s_[unit];
  if (repeated ||
      (repeated.error().kind == FaultKind::kTimeout && silent_for_s >= port_.line().late_answer_s)) {
    owed_since_s_.erase(unit);
    return {};
  }
  if (repeated.error().kind != FaultKind::kTimeout) return tl::make_unexpected(repeated.error());
  return fault(FaultKind::kTimeout, {},
               "unit " + std::to_string(unit) +
                   " is silent and still owes an answer; is it powered and its cable in place?");
}

Result<Bytes> RtuLink::ask(int unit, const Request& request, double deadline_s) {
  if (auto silent = await_silence(deadline_s); !silent) return tl::make_unexpected(silent.error());
  const Bytes frame = rtu_frame(unit, request.pdu);
  if (auto sent = port_.write(frame, deadline_s); !sent) return tl::make_unexpected(sent.error());
  quiet_since_s_ = wire_time_s() + static_cast<double>(frame.size()) * character_s_;
  return await_answer(unit, request, deadline_s);
}

Result<Bytes> RtuLink::await_answer(int unit, const Request& request, double deadline_s) {
  const double begin_s = wire_time_s();
  Bytes received;
  for (;;) {
    const RtuAnswer first = first_rtu_answer(received);
    if (first.state == RtuAnswer::State::kComplete) {
      const std::span<const uint8_t> frame(received.data(), first.length);
      if (frame[0] == unit) {
        auto answer = modbus_pdu::check_answer(request, frame.subspan(1, first.length - 3));
        if (answer) {
          if (received.size() > first.length) ++strays_;
          return answer;
        }
      }
      ++strays_;
      received.erase(received.begin(), received.begin() + static_cast<std::ptrdiff_t>(first.length));
      continue;
    }
    const auto damaged = [&] {
      return fault(FaultKind::kProtocol, {},
                   "damaged answer to the " + modbus_pdu::describe(request.pdu) + " of unit " +
                       std::to_string(unit) + " (" + std::to_string(received.size()) +
                       " bytes, checksum or length wrong); check cable, termination and baud rate");
    };
    if (first.state == RtuAnswer::State::kDamaged) return damaged();
    const double now_s = wire_time_s();
    if (now_s >= deadline_s) return modbus_faults::no_answer(request, unit, deadline_s - begin_s);
    const size_t before = received.size();
    const double until_s = before == 0 ? deadline_s : std::min(deadline_s, now_s + kByteTimeout_s);
    if (auto heard = port_.read(received, until_s); !heard) return tl::make_unexpected(heard.error());
    if (received.size() > before) {
      quiet_since_s_ = wire_time_s();
    } else if (before > 0 && wire_time_s() < deadline_s) {
      return damaged();
    }
  }
}

}  // namespace gantry
