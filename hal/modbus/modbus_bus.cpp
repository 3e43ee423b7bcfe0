#include "modbus/modbus_bus.h"

#include <modbus.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <utility>

#include "gantry/foundation/clock.h"

namespace gantry {
namespace {

constexpr uint8_t kReadDiscreteInputs = 0x02;
constexpr uint8_t kReadRegisters = 0x03;
constexpr uint8_t kWriteCoil = 0x05;
constexpr uint8_t kWriteRegisters = 0x10;
constexpr uint8_t kExceptionFlag = 0x80;
constexpr uint8_t kGatewayPathUnavailable = 0x0A;
constexpr uint8_t kGatewayTargetSilent = 0x0B;
constexpr size_t kHeaderBytes = 7;  // MBAP: transaction, protocol, length, unit.

// The wire runs in real time whatever the clock of the cell is.
double real_time_s() {
  return SteadyClock().now_s();
}

void append_u16(std::vector<uint8_t>& bytes, uint16_t value) {
  bytes.push_back(static_cast<uint8_t>(value >> 8));
  bytes.push_back(static_cast<uint8_t>(value & 0xFF));
}

uint16_t u16_at(std::span<const uint8_t> bytes, size_t index) {
  return static_cast<uint16_t>(bytes[index] << 8 | bytes[index + 1]);
}

// "read of register 9000h", for messages; a PDU starts with function code and address.
std::string describe(const std::vector<uint8_t>& request) {
  const char* what = request[0] == kReadDiscreteInputs ? "read of discrete input"
                     : request[0] == kReadRegisters    ? "read of register"
                     : request[0] == kWriteCoil        ? "write to coil"
                                                       : "write to register";
  char text[48];
  std::snprintf(text, sizeof text, "%s %04Xh", what, u16_at(request, 1));
  return text;
}

std::string exception_name(uint8_t code) {
  const auto name = [code]() -> const char* {
    switch (code) {
      case 0x01:
        return "illegal function";
      case 0x02:
        return "illegal data address";
      case 0x03:
        return "illegal data value";
      case 0x04:
        return "device failure";
      case 0x05:
        return "acknowledge";
      case 0x06:
        return "device busy";
      case kGatewayPathUnavailable:
        return "gateway path unavailable";
      case kGatewayTargetSilent:
        return "gateway target does not respond";
      default:
        return "unknown code";
    }
  };
  return "exception " + std::to_string(code) + ", " + name();
}

tl::unexpected<Fault> bus_fault(FaultKind kind, std::string message) {
  return fault(kind, {}, std::move(message));
}

std::string milliseconds(double seconds) {
  return std::to_string(std::lround(seconds * 1e3)) + " ms";
}

}  // namespace

void ModbusBus::ContextDeleter::operator()(modbus_t* context) const {
  modbus_close(context);
  modbus_free(context);
}

ModbusBus::ModbusBus(std::string host, int port) : host_(std::move(host)), port_(port) {}
ModbusBus::~ModbusBus() = default;

std::string ModbusBus::address() const {
  return host_ + ":" + std::to_string(port_);
}

void ModbusBus::close() {
  context_.reset();
}

// With a byte timeout of zero libmodbus lets the response timeout govern the whole answer instead of
// each piece of it: select(2) on Linux counts the remaining time down.
bool ModbusBus::limit_waiting_until(double deadline_s) {
  const double remaining_s = deadline_s - real_time_s();
  if (remaining_s <= 1e-6) return false;
  const auto microseconds = static_cast<uint64_t>(remaining_s * 1e6);
  modbus_set_response_timeout(context_.get(), static_cast<uint32_t>(microseconds / 1'000'000),
                              static_cast<uint32_t>(microseconds % 1'000'000));
  modbus_set_byte_timeout(context_.get(), 0, 0);
  return true;
}

// Between two exchanges nothing may arrive: readable means that the peer has closed the connection or
// has sent something that nobody asked for.
bool ModbusBus::connection_is_clean() const {
  pollfd events{modbus_get_socket(context_.get()), POLLIN, 0};
  return poll(&events, 1, 0) == 0;
}

Result<void> ModbusBus::open(double deadline_s) {
  if (context_ && connection_is_clean()) return {};
  close();
  context_.reset(modbus_new_tcp_pi(host_.c_str(), std::to_string(port_).c_str()));
  errno = 0;
  const bool connected = context_ && limit_waiting_until(deadline_s) && modbus_connect(context_.get()) == 0;
  if (connected) return {};
  // libmodbus leaves errno at EINPROGRESS when its wait for the connection ends without one.
  const std::string reason = modbus_strerror(errno == 0 || errno == EINPROGRESS ? ETIMEDOUT : errno);
  close();
  return bus_fault(FaultKind::kUnreachable,
                   "no connection: " + reason + "; is the drive powered and the address in CELL.yaml right?");
}

Result<ModbusBus::Bytes> ModbusBus::exchange(int unit, const Bytes& request, const Expected& expected,
                                             double deadline_s, double timeout_s) {
  const std::string what = describe(request);
  Bytes frame;
  append_u16(frame, ++transaction_);
  append_u16(frame, 0);  // Protocol: Modbus.
  append_u16(frame, static_cast<uint16_t>(request.size() + 1));
  frame.push_back(static_cast<uint8_t>(unit));
  frame.insert(frame.end(), request.begin(), request.end());

  const auto sent = send(modbus_get_socket(context_.get()), frame.data(), frame.size(), MSG_NOSIGNAL);
  if (sent != static_cast<ssize_t>(frame.size()))
    return bus_fault(FaultKind::kUnreachable, what + ": connection lost: " + modbus_strerror(errno));

  const auto no_answer = [&] {
    return bus_fault(FaultKind::kTimeout, "no complete answer to the " + what + " within " +
                                              milliseconds(timeout_s) + "; is unit " + std::to_string(unit) +
                                              " powered and its cable in place?");
  };
  if (!limit_waiting_until(deadline_s)) return no_answer();
  std::array<uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> buffer{};
  const int received = modbus_receive_confirmation(context_.get(), buffer.data());
  if (received < 0) {
    if (errno == ETIMEDOUT) return no_answer();
    if (errno == ECONNRESET || errno == EPIPE)
      return bus_fault(FaultKind::kUnreachable,
                       "the connection was closed during the " + what +
                           "; did the drive restart, or does somebody else hold it?");
    return bus_fault(FaultKind::kProtocol, "bad answer to the " + what + ": " + modbus_strerror(errno));
  }

  return check({buffer.data(), static_cast<size_t>(received)}, unit, request, expected);
}

Result<ModbusBus::Bytes> ModbusBus::check(std::span<const uint8_t> answer, int unit, const Bytes& request,
                                          const Expected& expected) const {
  const auto wrong = [&request](const char* field, size_t found, size_t wanted) {
    return bus_fault(FaultKind::kProtocol, "wrong answer to the " + describe(request) + ": " + field +
                                               " is " + std::to_string(found) + ", expected " +
                                               std::to_string(wanted));
  };
  const size_t length = answer.size() - kHeaderBytes + 1;  // As the header counts: unit and PDU.
  if (answer.size() < kHeaderBytes + 2) return wrong("its size", answer.size(), kHeaderBytes + 2);
  if (u16_at(answer, 0) != transaction_)
    return wrong("its transaction number", u16_at(answer, 0), transaction_);
  if (u16_at(answer, 2) != 0) return wrong("its protocol number", u16_at(answer, 2), 0);
  if (u16_at(answer, 4) != length) return wrong("its length field", u16_at(answer, 4), length);
  if (answer[6] != unit) return wrong("its unit", answer[6], static_cast<size_t>(unit));

  const auto pdu = answer.subspan(kHeaderBytes);
  if ((pdu[0] & ~kExceptionFlag) != request[0]) return wrong("its function code", pdu[0], request[0]);
  const bool exception = (pdu[0] & kExceptionFlag) != 0;
  const size_t expected_size = exception ? 2 : expected.size;
  if (pdu.size() != expected_size) return wrong("its size", pdu.size(), expected_size);
  if (!exception) {
    const auto difference = std::mismatch(expected.begin.begin(), expected.begin.end(), pdu.begin());
    if (difference.first != expected.begin.end())
      return wrong("an echoed byte", *difference.second, *difference.first);
  }
  return Bytes(pdu.begin(), pdu.end());
}

Result<ModbusBus::Bytes> ModbusBus::transact(int unit, const Bytes& request, const Expected& expected,
                                             double timeout_s) {
  std::lock_guard lock(mutex_);
  const double deadline_s = real_time_s() + timeout_s;
  if (auto opened = open(deadline_s); !opened) return tl::make_unexpected(opened.error());
  auto answer = exchange(unit, request, expected, deadline_s, timeout_s);
  if (!answer) {
    close();
    return answer;
  }
  if ((answer->front() & kExceptionFlag) == 0) return answer;
  // An exception is a proper answer: the connection stays.
  const uint8_t code = answer->back();
  if (code == kGatewayPathUnavailable || code == kGatewayTargetSilent)
    return bus_fault(FaultKind::kUnreachable, "the gateway reaches no unit " + std::to_string(unit) + " (" +
                                                  exception_name(code) +
                                                  "); is the drive powered and its unit in CELL.yaml right?");
  return bus_fault(FaultKind::kRefused,
                   "the drive refused the " + describe(request) + " (" + exception_name(code) + ")");
}

Result<std::vector<bool>> ModbusBus::read_discrete_inputs(int unit, uint16_t first, uint16_t count,
                                                          double timeout_s) {
  Bytes request{kReadDiscreteInputs};
  append_u16(request, first);
  append_u16(request, count);
  const auto bytes = static_cast<uint8_t>((count + 7) / 8);
  const auto answer = transact(unit, request, {{kReadDiscreteInputs, bytes}, 2u + bytes}, timeout_s);
  if (!answer) return tl::make_unexpected(answer.error());
  // The first input is the lowest bit of the first byte (Modbus Application Protocol V1.1b3, 6.2).
  std::vector<bool> inputs;
  for (size_t i = 0; i < count; ++i) inputs.push_back(((*answer)[2 + i / 8] >> (i % 8) & 1) != 0);
  return inputs;
}

Result<std::vector<uint16_t>> ModbusBus::read_registers(int unit, uint16_t first, uint16_t count,
                                                        double timeout_s) {
  Bytes request{kReadRegisters};
  append_u16(request, first);
  append_u16(request, count);
  const auto bytes = static_cast<uint8_t>(2 * count);
  const auto answer = transact(unit, request, {{kReadRegisters, bytes}, 2u + bytes}, timeout_s);
  if (!answer) return tl::make_unexpected(answer.error());
  std::vector<uint16_t> registers;
  for (size_t i = 0; i < count; ++i) registers.push_back(u16_at(*answer, 2 + 2 * i));
  return registers;
}

Result<void> ModbusBus::write_registers(int unit, uint16_t first, std::span<const uint16_t> values,
                                        double timeout_s) {
  Bytes request{kWriteRegisters};
  append_u16(request, first);
  append_u16(request, static_cast<uint16_t>(values.size()));
  const Bytes echo = request;
  request.push_back(static_cast<uint8_t>(2 * values.size()));
  for (const uint16_t value : values) append_u16(request, value);
  const auto answer = transact(unit, request, {echo, echo.size()}, timeout_s);
  if (!answer) return tl::make_unexpected(answer.error());
  return {};
}

Result<void> ModbusBus::write_coil(int unit, uint16_t coil, bool on, double timeout_s) {
  Bytes request{kWriteCoil};
  append_u16(request, coil);
  append_u16(request, on ? 0xFF00 : 0x0000);
  const auto answer = transact(unit, request, {request, request.size()}, timeout_s);
  if (!answer) return tl::make_unexpected(answer.error());
  return {};
}

}  // namespace gantry
