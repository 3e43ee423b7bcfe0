#include "modbus/serial_port.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>

#include "modbus/modbus_link.h"

namespace gantry {
namespace {

speed_t speed_of(int baud) {
  switch (baud) {
    case 9600:
      return B9600;
    case 19200:
      return B19200;
    case 38400:
      return B38400;
    case 57600:
      return B57600;
    case 115200:
      return B115200;
    case 230400:
      return B230400;
    default:
      return B0;
  }
}

/// A pseudo-terminal has no line, hence neither rate nor parity; glibc reports that it does not take them.
bool is_pseudo_terminal(int descriptor) {
  struct stat status {};
  constexpr unsigned kFirstMajor = 136, kLastMajor = 143;
  return fstat(descriptor, &status) == 0 && major(status.st_rdev) >= kFirstMajor &&
         major(status.st_rdev) <= kLastMajor;
}

/// False when the driver did not take the settings.
bool configure(int descriptor, const SerialLine& line) {
  termios mode{};
  if (tcgetattr(descriptor, &mode) != 0) return false;
  cfmakeraw(&mode);
  mode.c_cflag |= CLOCAL | CREAD;
  mode.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | CSTOPB | PARENB | PARODD | CSIZE);
  mode.c_cflag |= CS8;
  mode.c_cc[VMIN] = 0;
  mode.c_cc[VTIME] = 0;
  if (is_pseudo_terminal(descriptor)) return tcsetattr(descriptor, TCSANOW, &mode) == 0;
  if (line.stop_bits == 2) mode.c_cflag |= CSTOPB;
  if (line.parity != Parity::kNone) mode.c_cflag |= PARENB;
  if (line.parity == Parity::kOdd) mode.c_cflag |= PARODD;
  const speed_t speed = speed_of(line.baud);
  return cfsetispeed(&mode, speed) == 0 && cfsetospeed(&mode, speed) == 0 &&
         tcsetattr(descriptor, TCSANOW, &mode) == 0;
}

int milliseconds_until(double deadline_s) {
  const double remaining_s = deadline_s - wire_time_s();
  return remaining_s <= 0 ? 0 : static_cast<int>(std::ceil(std::min(remaining_s, 1e6) * 1e3));
}

}  // namespace

tl::unexpected<Fault> SerialPort::lost(const std::string& reason) {
  close();
  return fault(FaultKind::kUnreachable, {},
               "serial line " + line_.device + ": " + reason + "; is the adapter plugged in?");
}

void SerialPort::close() {
  if (descriptor_ >= 0) ::close(descriptor_);
  descriptor_ = -1;
}

Result<void> SerialPort::open() {
  if (is_open()) return {};
  descriptor_ = ::open(line_.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (descriptor_ < 0) return lost(std::strerror(errno));
  if (!isatty(descriptor_)) return lost("this is no serial device");
  if (flock(descriptor_, LOCK_EX | LOCK_NB) != 0) return lost("another program holds it");
  if (!configure(descriptor_, line_))
    return lost("its driver refuses " + std::to_string(line_.baud) + " baud (" + std::strerror(errno) + ")");
  tcflush(descriptor_, TCIOFLUSH);
  return {};
}

Result<void> SerialPort::write(std::span<const uint8_t> bytes, double deadline_s) {
  while (!bytes.empty()) {
    const ssize_t count = ::write(descriptor_, bytes.data(), bytes.size());
    if (count > 0) {
      bytes = bytes.subspan(static_cast<size_t>(count));
      continue;
    }
    if (count < 0 && errno != EAGAIN && errno != EINTR) return lost(std::strerror(errno));
    pollfd events{descriptor_, POLLOUT, 0};
    if (poll(&events, 1, milliseconds_until(deadline_s)) == 0) {
      // What was left in the buffer must not go out later, in front of another request.
      tcflush(descriptor_, TCOFLUSH);
      return fault(FaultKind::kTimeout, {}, "serial line " + line_.device + " takes no more bytes");
    }
  }
  return {};
}

Result<void> SerialPort::read(std::vector<uint8_t>& bytes, double deadline_s) {
  for (;;) {
    pollfd events{descriptor_, POLLIN, 0};
    const int ready = poll(&events, 1, milliseconds_until(deadline_s));
    if (ready < 0 && errno == EINTR) continue;
    if (ready == 0) return {};
    std::array<uint8_t, 512> chunk;
    const ssize_t count = ::read(descriptor_, chunk.data(), chunk.size());
    if (count > 0) {
      bytes.insert(bytes.end(), chunk.begin(), chunk.begin() + count);
      return {};
    }
    if (count < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    return lost(count == 0 ? "the device is gone" : std::strerror(errno));
  }
}

}  // namespace gantry
