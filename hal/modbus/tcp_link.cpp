#include "modbus/tcp_link.h"

#include <modbus.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <utility>

namespace gantry {

using modbus_pdu::append_u16;
using modbus_pdu::Bytes;
using modbus_pdu::Request;
using modbus_pdu::u16_at;

namespace {

constexpr size_t kHeaderBytes = 7;  // MBAP: transaction, protocol, length, unit.

tl::unexpected<Fault> link_fault(FaultKind kind, std::string message) {
  return fault(kind, {}, std::move(message));
}

}  // namespace

void TcpLink::ContextDeleter::operator()(modbus_t* context) const {
  modbus_close(context);
  modbus_free(context);
}

// With a byte timeout of zero libmodbus lets the response timeout govern the whole answer instead of
// each piece of it: select(2) on Linux counts the remaining time down.
bool TcpLink::limit_waiting_until(double deadline_s) {
  const double remaining_s = deadline_s - wire_time_s();
  if (remaining_s <= 1e-6) return false;
  const auto microseconds = static_cast<uint64_t>(remaining_s * 1e6);
  modbus_set_response_timeout(context_.get(), static_cast<uint32_t>(microseconds / 1'000'000),
                              static_cast<uint32_t>(microseconds % 1'000'000));
  modbus_set_byte_timeout(context_.get(), 0, 0);
  return true;
}

// Between two exchanges nothing may arrive: readable means that the peer has closed the connection or
// has sent something that nobody asked for.
bool TcpLink::connection_is_clean() const {
  pollfd events{modbus_get_socket(context_.get()), POLLIN, 0};
  return poll(&events, 1, 0) == 0;
}

Result<void> TcpLink::open(double deadline_s) {
  if (context_) {
    if (connection_is_clean()) return {};
    uint8_t byte;
    if (recv(modbus_get_socket(context_.get()), &byte, 1, MSG_PEEK | MSG_DONTWAIT) > 0) ++strays_;
  }
  context_.reset(modbus_new_tcp_pi(host_.c_str(), std::to_string(port_).c_str()));
  errno = 0;
  const bool connected = context_ && limit_waiting_until(deadline_s) && modbus_connect(context_.get()) == 0;
  if (connected) {
    ++openings_;
    return {};
  }
  // libmodbus leaves errno at EINPROGRESS when its wait for the connection ends without one.
  const std::string reason = modbus_strerror(errno == 0 || errno == EINPROGRESS ? ETIMEDOUT : errno);
  context_.reset();
  return link_fault(
      FaultKind::kUnreachable,
      "no connection: " + reason + "; is the device powered and the address in CELL.yaml right?");
}

Result<Bytes> TcpLink::exchange(int unit, const Request& request, double deadline_s) {
  const double begin_s = wire_time_s();
  if (auto opened = open(deadline_s); !opened) return tl::make_unexpected(opened.error());
  auto answer = ask(unit, request, deadline_s, begin_s);
  if (!answer) context_.reset();
  return answer;
}

Result<Bytes> TcpLink::ask(int unit, const Request& request, double deadline_s, double begin_s) {
  const std::string what = modbus_pdu::describe(request.pdu);
  Bytes frame;
  append_u16(frame, ++transaction_);
  append_u16(frame, 0);  // Protocol: Modbus.
  append_u16(frame, static_cast<uint16_t>(request.pdu.size() + 1));
  frame.push_back(static_cast<uint8_t>(unit));
  frame.insert(frame.end(), request.pdu.begin(), request.pdu.end());

  const auto sent = send(modbus_get_socket(context_.get()), frame.data(), frame.size(), MSG_NOSIGNAL);
  if (sent != static_cast<ssize_t>(frame.size()))
    return link_fault(FaultKind::kUnreachable, what + ": connection lost: " + modbus_strerror(errno));

  const auto no_answer = [&] { return modbus_faults::no_answer(request, unit, deadline_s - begin_s); };
  if (!limit_waiting_until(deadline_s)) return no_answer();
  std::array<uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> buffer{};
  const int received = modbus_receive_confirmation(context_.get(), buffer.data());
  if (received < 0) {
    if (errno == ETIMEDOUT) return no_answer();
    if (errno == ECONNRESET || errno == EPIPE)
      return link_fault(FaultKind::kUnreachable,
                        "the connection was closed during the " + what +
                            "; did the drive restart, or does somebody else hold it?");
    return link_fault(FaultKind::kProtocol, "bad answer to the " + what + ": " + modbus_strerror(errno));
  }

  const std::span<const uint8_t> answer(buffer.data(), static_cast<size_t>(received));
  const auto wrong = [&what](const char* field, size_t found, size_t wanted) {
    return link_fault(FaultKind::kProtocol, "wrong answer to the " + what + ": " + field + " is " +
                                                std::to_string(found) + ", expected " +
                                                std::to_string(wanted));
  };
  const size_t length = answer.size() - kHeaderBytes + 1;  // As the header counts: unit and PDU.
  if (answer.size() < kHeaderBytes + 2) return wrong("its size", answer.size(), kHeaderBytes + 2);
  if (u16_at(answer, 0) != transaction_)
    return wrong("its transaction number", u16_at(answer, 0), transaction_);
  if (u16_at(answer, 2) != 0) return wrong("its protocol number", u16_at(answer, 2), 0);
  if (u16_at(answer, 4) != length) return wrong("its length field", u16_at(answer, 4), length);
  if (answer[6] != unit) return wrong("its unit", answer[6], static_cast<size_t>(unit));
  return modbus_pdu::check_answer(request, answer.subspan(kHeaderBytes));
}

}  // namespace gantry
