#pragma once

#include <memory>

#include "modbus/modbus_link.h"

struct _modbus;  // libmodbus calls it modbus_t.

namespace gantry {

/// One Modbus TCP connection to a drive, or to a gateway with several units behind it (Modbus Messaging on
/// TCP/IP Implementation Guide V1.0b).
///
/// libmodbus does not compare the unit of an answer on TCP, so requests are framed and answers checked here;
/// libmodbus connects, receives and keeps the time. After a timeout or a wrong answer the connection is
/// closed: a late answer dies with it.
class TcpLink final : public ModbusLink {
 public:
  TcpLink(std::string host, int port) : host_(std::move(host)), port_(port) {}

  std::string address() const override { return host_ + ":" + std::to_string(port_); }
  Result<modbus_pdu::Bytes> exchange(int unit, const modbus_pdu::Request& request,
                                     double deadline_s) override;
  int openings() const override { return openings_; }
  int strays() const override { return strays_; }

 private:
  struct ContextDeleter {
    void operator()(_modbus* context) const;
  };

  Result<void> open(double deadline_s);
  Result<modbus_pdu::Bytes> ask(int unit, const modbus_pdu::Request& request, double deadline_s,
                                double begin_s);
  bool connection_is_clean() const;
  bool limit_waiting_until(double deadline_s);

  const std::string host_;
  const int port_;
  std::unique_ptr<_modbus, ContextDeleter> context_;  ///< Null while there is no connection.
  uint16_t transaction_ = 0;
  int openings_ = 0;
  int strays_ = 0;
};

}  // namespace gantry
