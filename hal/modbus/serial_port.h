#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"
#include "gantry/hal/modbus_drives.h"

namespace gantry {

/// A serial device (or a pty) that may vanish and come back: a USB adapter that is unplugged. Raw bytes, no
/// waiting except where a deadline says so. Held exclusively: a second program on the line is refused.
class SerialPort {
 public:
  explicit SerialPort(SerialLine line) : line_(std::move(line)) {}
  ~SerialPort() { close(); }
  SerialPort(const SerialPort&) = delete;
  SerialPort& operator=(const SerialPort&) = delete;

  const SerialLine& line() const { return line_; }
  bool is_open() const { return descriptor_ >= 0; }
  /// Does nothing when it is open. What was received before is thrown away.
  Result<void> open();
  void close();

  /// Hands all bytes to the system's buffer. The port is closed where the device is gone.
  Result<void> write(std::span<const uint8_t> bytes, double deadline_s);
  /// Appends what arrives until the first byte or the deadline; what is there is taken even after the
  /// deadline. The port is closed where the device is gone.
  Result<void> read(std::vector<uint8_t>& bytes, double deadline_s);

 private:
  tl::unexpected<Fault> lost(const std::string& reason);

  SerialLine line_;
  int descriptor_ = -1;
};

}  // namespace gantry
