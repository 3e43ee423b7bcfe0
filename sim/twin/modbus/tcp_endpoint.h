#pragma once

#include <netinet/in.h>

#include <vector>

#include "drive_bank.h"
#include "endpoint.h"

namespace gantry {

/// A Modbus TCP server on loopback that behaves like an RTU gateway. Own framing: a reply must be possible to
/// spoil, and half a frame must not block the other clients.
class TcpEndpoint final : public Endpoint {
 public:
  TcpEndpoint(std::string address, int port, DriveBank& bank);
  ~TcpEndpoint() override { stop(); }

  void start() override;
  int port() const override { return port_; }

 private:
  struct Client {
    int number;
    Descriptor socket;
    std::vector<uint8_t> received;
  };

  std::string name() const { return address_ + ":" + std::to_string(port_); }
  Descriptor listen() const;
  void serve() override;
  void accept_clients();
  bool serve_client(Client& client);
  void send_due();

  const std::string address_;
  in_addr ip_{};
  int port_;
  DriveBank& bank_;
  // Of the serving thread:
  Descriptor listener_;
  std::vector<Client> clients_;
  ReplyQueue replies_;
  int last_client_ = 0;
};

}  // namespace gantry
