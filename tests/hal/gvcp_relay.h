#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace gantry {

/// Datagrams of GVCP (GigE Vision 2.0, part 1) by hand, as an ill-behaved bystander would send them.
class GvcpPeer {
 public:
  static constexpr uint16_t kPort = 3956;
  static constexpr uint16_t kReadRegister = 0x0080;
  static constexpr uint16_t kWriteRegister = 0x0082;
  static constexpr uint16_t kReadMemory = 0x0084;
  static constexpr uint16_t kWriteMemory = 0x0086;

  explicit GvcpPeer(const std::string& camera)
      : fd_(socket(AF_INET, SOCK_DGRAM, 0)), camera_(address_of(camera)) {}
  ~GvcpPeer() { close(fd_); }
  GvcpPeer(const GvcpPeer&) = delete;
  GvcpPeer& operator=(const GvcpPeer&) = delete;

  static sockaddr_in address_of(const std::string& ip) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(kPort);
    inet_pton(AF_INET, ip.c_str(), &address.sin_addr);
    return address;
  }

  /// Sends one request and returns the whole acknowledge, empty when none came within a second.
  std::vector<uint8_t> exchange(const std::vector<uint8_t>& request) {
    sendto(fd_, request.data(), request.size(), 0, reinterpret_cast<const sockaddr*>(&camera_),
           sizeof(camera_));
    pollfd poll_fd{fd_, POLLIN, 0};
    if (poll(&poll_fd, 1, 1000) <= 0) return {};
    std::vector<uint8_t> reply(65536);
    const ssize_t size = recv(fd_, reply.data(), reply.size(), 0);
    reply.resize(size > 0 ? static_cast<size_t>(size) : 0);
    return reply;
  }

  static std::vector<uint8_t> command(uint16_t code, const std::vector<uint32_t>& words) {
    std::vector<uint8_t> out{0x42, 0x01};
    put16(out, code);
    put16(out, static_cast<uint16_t>(4 * words.size()));
    put16(out, 1);  // request id
    for (uint32_t word : words) {
      put16(out, static_cast<uint16_t>(word >> 16));
      put16(out, static_cast<uint16_t>(word));
    }
    return out;
  }

  std::string read_memory(uint32_t address, uint32_t size) {
    std::string out;
    while (size > 0) {
      const uint32_t piece = std::min(size, 512u);
      const auto reply = exchange(command(kReadMemory, {address, piece}));
      if (reply.size() != 12 + piece) throw std::runtime_error("READMEM failed");
      out.append(reply.begin() + 12, reply.end());
      address += piece;
      size -= piece;
    }
    return out;
  }

 private:
  static void put16(std::vector<uint8_t>& out, uint16_t value) {
    out.push_back(static_cast<uint8_t>(value >> 8));
    out.push_back(static_cast<uint8_t>(value));
  }

  int fd_;
  sockaddr_in camera_;
};

/// Stands between a client and a camera and passes their GVCP on, except that the client reads an
/// edited GenICam description. So a well-behaved camera becomes one that lacks a feature. The stream
/// does not come this way: it goes from the camera straight to the client.
class GvcpRelay {
 public:
  /// `edits` are replaced, all of them, in order; none may make the description longer.
  GvcpRelay(const std::string& address, const std::string& camera,
            const std::vector<std::pair<std::string, std::string>>& edits)
      : upstream_(camera), fd_(socket(AF_INET, SOCK_DGRAM, 0)) {
    read_description();
    const size_t length = description_.size();
    for (const auto& [from, to] : edits) {
      size_t found = 0;
      size_t at = 0;
      for (; (at = description_.find(from, at)) != std::string::npos; at += to.size(), ++found) {
        description_.replace(at, from.size(), to);
      }
      if (found == 0) throw std::runtime_error("the description does not hold " + from);
    }
    if (description_.size() > length) throw std::runtime_error("the edited description is too long");
    description_.resize(length, '\n');
    sockaddr_in own = GvcpPeer::address_of(address);
    if (bind(fd_, reinterpret_cast<sockaddr*>(&own), sizeof(own)) != 0) {
      close(fd_);
      throw std::runtime_error(address + " is taken");
    }
    thread_ = std::thread([this] { serve(); });
  }
  ~GvcpRelay() {
    stop_ = true;
    thread_.join();
    close(fd_);
  }
  GvcpRelay(const GvcpRelay&) = delete;
  GvcpRelay& operator=(const GvcpRelay&) = delete;

  /// Sends the client's last register write once more, in its name: after a capture, the trigger.
  void repeat_last_write() {
    std::lock_guard lock(mutex_);
    std::vector<uint8_t> again = last_write_;
    again[6] = 0x70;  // A request id of its own, or the camera takes it for a retransmission.
    again[7] = ++repeats_;
    upstream_.exchange(again);
  }

 private:
  void read_description() {
    const std::string url =
        upstream_.read_memory(0x0200, 512).c_str();  // FirstURL: "Local:NAME;ADDRESS;LENGTH"
    const size_t first = url.find(';');
    const size_t second = url.find(';', first + 1);
    if (first == std::string::npos || second == std::string::npos)
      throw std::runtime_error("FirstURL is " + url);
    description_address_ = static_cast<uint32_t>(std::stoul(url.substr(first + 1), nullptr, 16));
    const auto length = static_cast<uint32_t>(std::stoul(url.substr(second + 1), nullptr, 16));
    description_ = upstream_.read_memory(description_address_, (length + 3) & ~3u);
    description_.resize(length);
  }

  void serve() {
    std::vector<uint8_t> request(65536);
    while (!stop_) {
      pollfd poll_fd{fd_, POLLIN, 0};
      if (poll(&poll_fd, 1, 20) <= 0) continue;
      sockaddr_in client{};
      socklen_t length = sizeof(client);
      const ssize_t size =
          recvfrom(fd_, request.data(), request.size(), 0, reinterpret_cast<sockaddr*>(&client), &length);
      if (size < 8) continue;
      const std::vector<uint8_t> reply = answer({request.begin(), request.begin() + size});
      if (!reply.empty()) {
        sendto(fd_, reply.data(), reply.size(), 0, reinterpret_cast<const sockaddr*>(&client), length);
      }
    }
  }

  std::vector<uint8_t> answer(const std::vector<uint8_t>& request) {
    std::lock_guard lock(mutex_);
    const auto code = static_cast<uint16_t>(request[2] << 8 | request[3]);
    std::vector<uint8_t> reply = upstream_.exchange(request);
    if (code == GvcpPeer::kWriteRegister || code == GvcpPeer::kWriteMemory) last_write_ = request;
    if (code == GvcpPeer::kReadMemory && reply.size() > 12) {
      const uint32_t address = static_cast<uint32_t>(request[8]) << 24 |
                               static_cast<uint32_t>(request[9]) << 16 |
                               static_cast<uint32_t>(request[10]) << 8 | request[11];
      for (size_t i = 12; i < reply.size(); ++i) {
        const size_t at = address + (i - 12) - size_t{description_address_};
        if (at < description_.size()) reply[i] = static_cast<uint8_t>(description_[at]);
      }
    }
    return reply;
  }

  GvcpPeer upstream_;
  int fd_;
  uint32_t description_address_ = 0;
  std::string description_;
  std::mutex mutex_;
  std::vector<uint8_t> last_write_;
  uint8_t repeats_ = 0;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace gantry
