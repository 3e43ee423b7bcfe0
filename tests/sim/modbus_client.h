#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <numbers>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"
#include "gantry/sim/twin/modbus_drives.h"

// A client without any of the project's code: the frames of the tests are written by hand from the manuals
// quoted in docs/modbus-drives.md, as hexadecimal PDUs.

namespace gantry {

using Bytes = std::vector<uint8_t>;

inline constexpr double kRadPerStep = 2 * std::numbers::pi / 36000;  // 0.01 degrees

inline Bytes bytes(const std::string& hex) {
  std::istringstream in(hex);
  Bytes result;
  for (unsigned byte; in >> std::hex >> byte;) result.push_back(static_cast<uint8_t>(byte));
  return result;
}

inline std::string hex(const Bytes& data) {
  std::string text;
  char digits[4];
  for (const uint8_t byte : data) {
    std::snprintf(digits, sizeof digits, "%s%02X", text.empty() ? "" : " ", byte);
    text += digits;
  }
  return text;
}

inline std::string hex16(int value) {
  return hex({static_cast<uint8_t>(value >> 8), static_cast<uint8_t>(value & 0xFF)});
}
/// Upper word first.
inline std::string hex32(int64_t value) {
  const auto bits = static_cast<uint32_t>(static_cast<int32_t>(value));
  return hex16(static_cast<int>(bits >> 16)) + " " + hex16(static_cast<int>(bits & 0xFFFF));
}

/// A raw TCP connection with a deadline, so that a hanging server fails the test.
class Connection {
 public:
  explicit Connection(int port) : fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in endpoint{};
    endpoint.sin_family = AF_INET;
    endpoint.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    endpoint.sin_port = htons(static_cast<uint16_t>(port));
    const timeval deadline{5, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &deadline, sizeof deadline);
    const int yes = 1;
    ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    EXPECT_EQ(::connect(fd_, reinterpret_cast<sockaddr*>(&endpoint), sizeof endpoint), 0);
  }
  ~Connection() { ::close(fd_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void send(const Bytes& data) { ::send(fd_, data.data(), data.size(), MSG_NOSIGNAL); }
  /// Up to `count` bytes; fewer when the server closes the connection or the deadline passes.
  Bytes receive(size_t count) {
    Bytes data(count);
    size_t have = 0;
    while (have < count) {
      const ssize_t got = ::recv(fd_, data.data() + have, count - have, 0);
      if (got <= 0) break;
      have += static_cast<size_t>(got);
    }
    data.resize(have);
    return data;
  }
  /// Whether the server ends the connection before the deadline.
  bool closed_by_server() {
    uint8_t byte;
    const ssize_t got = ::recv(fd_, &byte, 1, 0);
    return got == 0 || (got < 0 && errno == ECONNRESET);
  }
  /// One whole frame.
  Bytes receive_frame() {
    Bytes frame = receive(6);
    if (frame.size() < 6) return frame;
    const Bytes rest = receive(static_cast<size_t>(frame[4] << 8 | frame[5]));
    frame.insert(frame.end(), rest.begin(), rest.end());
    return frame;
  }
  /// The reply's PDU; checks transaction, protocol, length and unit.
  std::string ask(int unit, const std::string& pdu) {
    const Bytes body = bytes(pdu);
    ++transaction_;
    Bytes frame = bytes(hex16(transaction_) + " 00 00 " + hex16(static_cast<int>(body.size()) + 1));
    frame.push_back(static_cast<uint8_t>(unit));
    frame.insert(frame.end(), body.begin(), body.end());
    send(frame);
    const Bytes reply = receive_frame();
    if (reply.size() < 8) return "no reply";
    EXPECT_EQ(hex({reply.begin(), reply.begin() + 4}), hex16(transaction_) + " 00 00");
    EXPECT_EQ(reply[4] << 8 | reply[5], static_cast<int>(reply.size()) - 6);
    EXPECT_EQ(reply[6], unit);
    return hex({reply.begin() + 7, reply.end()});
  }
  std::vector<int> read(int unit, int address, int count) {
    const Bytes reply = bytes(ask(unit, "03 " + hex16(address) + " " + hex16(count)));
    std::vector<int> words(static_cast<size_t>(count), -1);
    EXPECT_EQ(reply.size(), 2 + 2 * words.size()) << hex(reply);
    for (size_t i = 0; i < words.size() && 3 + 2 * i < reply.size(); ++i)
      words[i] = reply[2 + 2 * i] << 8 | reply[3 + 2 * i];
    return words;
  }
  int32_t read32(int unit, int address) {
    const auto words = read(unit, address, 2);
    return static_cast<int32_t>(static_cast<uint32_t>(words[0]) << 16 | static_cast<uint32_t>(words[1]));
  }
  /// Sends a write that must be echoed the way its function demands.
  void write(int unit, const std::string& pdu) {
    const std::string reply = ask(unit, pdu);
    EXPECT_EQ(reply, pdu.substr(0, 2) == "10" ? pdu.substr(0, 14) : pdu);
  }

 private:
  int fd_;
  int transaction_ = 0x1200;
};

inline constexpr int kIai = 1;
inline constexpr int kAz = 2;

class ModbusDrives : public ::testing::Test {
 protected:
  ModbusDrives() {
    server_.add({"iai_robo_cylinder", kIai, 0.01}, linear_);
    server_.add({"oriental_motor_az", kAz, kRadPerStep}, tilt_);
    server_.start();
  }

  // IAI
  int status() { return client().read(kIai, 0x9005, 1)[0]; }
  bool moving() { return client().read(kIai, 0x9007, 1)[0] >> 5 & 1; }
  int alarm() { return client().read(kIai, 0x9002, 1)[0]; }
  int position() { return client().read32(kIai, 0x9000); }
  void coil(int address, bool on) {
    client().write(kIai, "05 " + hex16(address) + (on ? " FF 00" : " 00 00"));
  }
  /// The whole block at 9900, 150 mm/s and 0.30 G.
  void move(int target, int band = 2, int flags = 0) {
    client().write(kIai, "10 99 00 00 09 12 " + hex32(target) + " " + hex32(band) + " " + hex32(15000) + " " +
                             hex16(30) + " 00 00 " + hex16(flags));
  }
  void home_linear() {
    coil(0x0403, true);
    coil(0x040B, false);
    coil(0x040B, true);
    ASSERT_TRUE(until([&] { return status() >> 4 & 1 && !moving(); }));
    coil(0x040B, false);
  }

  // AZ
  int outputs() { return client().read(kAz, 0x007F, 1)[0]; }
  bool output(int number) { return outputs() >> number & 1; }
  void inputs(int word) { client().write(kAz, "10 00 7C 00 02 04 00 00 " + hex16(word)); }
  static std::string direct(int type, int64_t position, int speed = 2000, int trigger = 1) {
    return "10 00 58 00 10 20 " + hex32(0) + " " + hex32(type) + " " + hex32(position) + " " + hex32(speed) +
           " " + hex32(5000) + " " + hex32(5000) + " " + hex32(1000) + " " + hex32(trigger);
  }
  int32_t az_alarm() { return client().read32(kAz, 0x0080); }
  int32_t steps() { return client().read32(kAz, 0x0120); }
  bool az_standstill() {
    return until([&] { return !output(13); });
  }
  void home_tilt() {
    inputs(0);
    inputs(1 << 4);
    ASSERT_TRUE(until([&] { return output(4) && !output(13); }));
    inputs(0);
  }

  /// Advances the clock until the condition holds, for at most a minute of its time.
  template <typename Condition>
  bool until(Condition condition) {
    for (int i = 0; i < 3000; ++i) {
      if (condition()) return true;
      clock_.sleep_s(0.02);
    }
    return false;
  }

  Connection& client() {
    if (!client_) client_ = std::make_unique<Connection>(server_.port());
    return *client_;
  }

  VirtualClock clock_;
  SimulatedStage linear_{{-200, 300, 200, 2000, 50, 0.01, 0.002, 0.15}, 7};
  SimulatedStage tilt_{{-1.0, 1.2, 1.0, 5.0, 0.3, kRadPerStep, 1e-5, 0.15}, 8};
  ModbusDriveServer server_{"127.0.0.1", 0, clock_};
  std::unique_ptr<Connection> client_;
};

}  // namespace gantry
