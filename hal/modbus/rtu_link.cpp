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
      return fault(FaultKind::kTimeout, {},
                   "serial line " + address() +
                       (stray ? " is never quiet; who else sends?" : ": no time was left for the request"));
  }
  if (stray) ++strays_;
  return {};
}

Result<Bytes> RtuLink::exchange(int unit, const Request& request, double deadline_s) {
  if (!port_.is_open()) {
    if (auto opened = port_.open(); !opened) return tl::make_unexpected(opened.error());
    ++openings_;
  }
  if (owed_.contains(unit)) {
    if (auto settled = settle(unit, deadline_s); !settled) return tl::make_unexpected(settled.error());
  }
  auto sent = send(unit, request, deadline_s);
  auto answer =
      sent ? await_answer(unit, request, deadline_s) : Result<Bytes>(tl::make_unexpected(sent.error()));
  if (!answer) owed_[unit] = {wire_time_s(), last_check_};
  return answer;
}

// Any answer to a check that was sent since the answer went missing will do: an earlier check's may be late
// too.
Result<void> RtuLink::settle(int unit, double deadline_s) {
  Owed& owed = owed_.at(unit);
  const double begin_s = wire_time_s(), half_s = begin_s + (deadline_s - begin_s) / 2;
  const Request check = modbus_pdu::echo(++last_check_);
  const Request any_check{check.pdu, {check.pdu.begin(), check.pdu.begin() + 3}, check.answer_size};
  if (auto sent = send(unit, check, half_s); !sent) return sent;
  for (;;) {
    const auto answer = await_answer(unit, any_check, half_s);
    if (!answer && answer.error().kind != FaultKind::kTimeout) return tl::make_unexpected(answer.error());
    if (!answer) break;
    const bool exception = (answer->front() & modbus_pdu::kExceptionFlag) != 0;
    // Numbers count up and wrap around: how many checks ago that one was, and how many there have been since.
    const auto ago = [this](uint16_t number) { return static_cast<uint16_t>(last_check_ - number); };
    if (exception || ago(modbus_pdu::u16_at(*answer, 3)) < ago(owed.last_check)) {
      owed_.erase(unit);
      return {};
    }
  }
  if (wire_time_s() - owed.since_s >= port_.line().late_answer_s) {
    owed_.erase(unit);
    return {};
  }
  return fault(FaultKind::kTimeout, {},
               "unit " + std::to_string(unit) +
                   " is silent and still owes an answer; is it powered and its cable in place?");
}

Result<void> RtuLink::send(int unit, const Request& request, double deadline_s) {
  if (auto silent = await_silence(deadline_s); !silent) return silent;
  const Bytes frame = rtu_frame(unit, request.pdu);
  if (auto sent = port_.write(frame, deadline_s); !sent) return sent;
  quiet_since_s_ = wire_time_s() + static_cast<double>(frame.size()) * character_s_;
  return {};
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
