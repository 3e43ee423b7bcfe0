#pragma once

#include <netinet/in.h>

#include <cstdint>

namespace gantry::gige {

/// IPv4 address and UDP port in host byte order.
struct Endpoint {
  uint32_t ip = 0;
  uint16_t port = 0;

  bool operator==(const Endpoint&) const = default;
};

sockaddr_in to_sockaddr(Endpoint endpoint);
Endpoint to_endpoint(const sockaddr_in& address);

/// An unconnected, bound UDP socket, closed with its owner.
class UdpSocket {
 public:
  UdpSocket() = default;
  ~UdpSocket();
  UdpSocket(const UdpSocket&) = delete;
  UdpSocket& operator=(const UdpSocket&) = delete;

  /// 0, or errno. `shared`: others may bind the same address too (SO_REUSEADDR).
  int bind(Endpoint local, bool shared = false);
  bool is_open() const { return fd_ >= 0; }
  int fd() const { return fd_; }
  Endpoint local() const;

 private:
  void close();

  int fd_ = -1;
};

}  // namespace gantry::gige
