#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <vector>

#include "gantry/foundation/clock.h"
#include "gantry/hal/modbus_drives.h"

namespace gantry {

using Bytes = std::vector<uint8_t>;

/// A TCP server on a free loopback port that hands each complete request (7 bytes of header and what they
/// announce) to `answer`, one thread per connection. Closing it closes every connection.
class RawServer {
 public:
  /// Gets the request and the number of the connection, from 1; sends with say(), or closes by returning
  /// false.
  using Answer = std::function<bool(const Bytes& request, int connection, int socket)>;

  explicit RawServer(Answer answer, int port = 0) : answer_(std::move(answer)) {
    listener_ = socket(AF_INET, SOCK_STREAM, 0);
    const int yes = 1;
    setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<uint16_t>(port));
    socklen_t size = sizeof address;
    if (bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 || listen(listener_, 8) != 0)
      throw std::runtime_error("the test server cannot listen");
    getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    acceptor_ = std::thread([this] { accept_all(); });
  }

  ~RawServer() {
    shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    ::close(listener_);
    drop_connections();
    for (auto& thread : threads_) thread.join();
    for (const int socket : sockets_) ::close(socket);
  }

  int port() const { return port_; }
  int connections() const { return connections_; }

  void drop_connections() {
    std::lock_guard lock(mutex_);
    for (const int socket : sockets_) shutdown(socket, SHUT_RDWR);
  }

  static void say(int socket, const Bytes& bytes) {
    (void)!send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
  }

 private:
  void accept_all() {
    for (;;) {
      const int socket = accept(listener_, nullptr, nullptr);
      if (socket < 0) return;
      std::lock_guard lock(mutex_);
      sockets_.push_back(socket);
      threads_.emplace_back([this, socket, number = ++connections_] { serve(socket, number); });
    }
  }

  void serve(int socket, int number) {
    for (;;) {
      Bytes request(6);
      if (recv(socket, request.data(), 6, MSG_WAITALL) != 6) break;
      const size_t rest = request[4] << 8 | request[5];
      request.resize(6 + rest);
      if (recv(socket, request.data() + 6, rest, MSG_WAITALL) != static_cast<ssize_t>(rest)) break;
      if (!answer_(request, number, socket)) break;
    }
    shutdown(socket, SHUT_RDWR);
  }

  Answer answer_;
  int listener_ = -1;
  int port_ = 0;
  std::atomic<int> connections_{0};
  std::mutex mutex_;
  std::vector<int> sockets_;
  std::vector<std::thread> threads_;
  std::thread acceptor_;
};

/// Header and PDU of an answer to `request`.
inline Bytes frame(const Bytes& request, const Bytes& pdu) {
  Bytes bytes{request[0], request[1], 0, 0, 0, static_cast<uint8_t>(pdu.size() + 1), request[6]};
  for (const uint8_t byte : pdu) bytes.push_back(byte);
  return bytes;
}

/// What a well-behaved IAI drive answers; reads of the status block give `position` counts, servo on, homed.
inline Bytes proper(const Bytes& request, uint8_t position = 0) {
  if (request[7] != 0x03) return frame(request, Bytes(request.begin() + 7, request.begin() + 12));
  Bytes pdu{0x03, 20};
  pdu.resize(22, 0);
  pdu[5] = position;
  pdu[12] = 0x10;  // 9005: servo on
  pdu[13] = 0x18;  // homed, positioned
  return frame(request, pdu);
}

inline constexpr double kTimeout_s = 0.15;

inline std::unique_ptr<Drive> iai_at(int port, Clock& clock, int unit = 2,
                                     std::shared_ptr<ModbusBus> bus = nullptr) {
  ModbusDriveConfig config;
  config.axis = "linear";
  config.profile = "iai_robo_cylinder";
  config.host = "127.0.0.1";
  config.port = port;
  config.unit = unit;
  config.in_position = 0.1;
  config.response_timeout_s = kTimeout_s;
  return make_modbus_drive(config, std::move(bus), clock);
}

inline double seconds_of(const std::function<void()>& action) {
  const auto begin = std::chrono::steady_clock::now();
  action();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

// Slack of the time limits for a machine that is busy with other things.
inline constexpr double kSlack_s = 0.5;

/// Holding registers that the test sets; writes are kept and acknowledged, nothing else happens.
class RegisterServer {
 public:
  RegisterServer()
      : server_([this](const Bytes& request, int, int socket) {
          RawServer::say(socket, frame(request, answer(request)));
          return true;
        }) {}

  int port() const { return server_.port(); }
  void set(uint16_t address, uint16_t value) {
    std::lock_guard lock(mutex_);
    registers_[address] = value;
  }
  uint16_t get(uint16_t address) {
    std::lock_guard lock(mutex_);
    return registers_[address];
  }
  /// What the drive does about a write: called with all registers, the address and the value.
  using React =
      std::function<void(std::map<uint16_t, uint16_t>& registers, uint16_t address, uint16_t value)>;
  void on_write(React react) {
    std::lock_guard lock(mutex_);
    react_ = std::move(react);
  }
  /// Everything that was written there, in order.
  std::vector<uint16_t> written(uint16_t address) {
    std::lock_guard lock(mutex_);
    return written_[address];
  }

 private:
  Bytes answer(const Bytes& request) {
    std::lock_guard lock(mutex_);
    const auto word = [&](size_t i) { return static_cast<uint16_t>(request[i] << 8 | request[i + 1]); };
    const uint16_t first = word(8), count = word(10);
    if (request[7] == 0x03) {
      Bytes pdu{0x03, static_cast<uint8_t>(2 * count)};
      for (int i = 0; i < count; ++i) {
        const uint16_t value = registers_[static_cast<uint16_t>(first + i)];
        pdu.push_back(static_cast<uint8_t>(value >> 8));
        pdu.push_back(static_cast<uint8_t>(value & 0xFF));
      }
      return pdu;
    }
    const bool several = request[7] == 0x10;
    if (several || request[7] == 0x06) {
      for (size_t i = 0; i < (several ? count : 1); ++i) {
        const auto address = static_cast<uint16_t>(first + i);
        const uint16_t value = word(several ? 13 + 2 * i : 10);
        registers_[address] = value;
        written_[address].push_back(value);
        if (react_) react_(registers_, address, value);
      }
    }
    return Bytes(request.begin() + 7, request.begin() + 12);
  }

  std::mutex mutex_;
  std::map<uint16_t, uint16_t> registers_;
  std::map<uint16_t, std::vector<uint16_t>> written_;
  React react_;
  RawServer server_;
};

/// A drive whose registers only the test changes.
class SlowDrive : public testing::Test {
 protected:
  DriveStatus read() {
    const auto status = drive->read_status();
    EXPECT_TRUE(status) << status.error().text();
    return status.value_or(DriveStatus{});
  }

  RegisterServer server;
  VirtualClock clock;
  std::unique_ptr<Drive> drive;
};

}  // namespace gantry
