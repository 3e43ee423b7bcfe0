#pragma once

#include "drive_bank.h"
#include "endpoint.h"
#include "gantry/sim/twin/modbus_drives.h"

namespace gantry {

/// Modbus RTU drives on a pseudo-terminal, all on one line. A pty has no baud rate: where asked to be honest,
/// the replies come as late as the bytes of both directions would need.
class SerialEndpoint final : public Endpoint {
 public:
  SerialEndpoint(TwinSerialLine line, DriveBank& bank) : line_(std::move(line)), bank_(bank) {}
  ~SerialEndpoint() override;

  void start() override;
  std::string device() const override;

 private:
  bool plug();
  void unplug();
  void serve() override;
  bool receive();
  void remove_link() const;

  const TwinSerialLine line_;
  DriveBank& bank_;
  mutable std::mutex device_mutex_;
  std::string device_;
  // Of the serving thread:
  Descriptor master_;
  Descriptor slave_;  ///< Held open, so that the line stays when a client leaves it.
  std::vector<uint8_t> received_;
  double received_at_s_ = 0;
  ReplyQueue replies_;
};

}  // namespace gantry
