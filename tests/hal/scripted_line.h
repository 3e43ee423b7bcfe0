#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "gantry/hal/modbus_drives.h"
#include "modbus/rtu_frame.h"

namespace gantry {

/// A pseudo-terminal whose other end is a function: it gets each request frame (all of eight bytes, which is
/// what reads and single writes have) and writes what it likes.
class ScriptedLine {
 public:
  using Bytes = std::vector<uint8_t>;
  using Answer = std::function<void(const Bytes& request, const std::function<void(const Bytes&)>& say)>;

  explicit ScriptedLine(Answer answer) : answer_(std::move(answer)) {
    master_ = posix_openpt(O_RDWR | O_NOCTTY);
    if (master_ < 0 || grantpt(master_) != 0 || unlockpt(master_) != 0)
      throw std::runtime_error("no pseudo-terminal");
    device_ = ptsname(master_);
    slave_ = open(device_.c_str(), O_RDWR | O_NOCTTY);
    termios mode{};
    tcgetattr(slave_, &mode);
    cfmakeraw(&mode);
    tcsetattr(slave_, TCSANOW, &mode);
    thread_ = std::thread([this] { serve(); });
  }
  ~ScriptedLine() {
    stop_ = true;
    thread_.join();
    ::close(slave_);
    ::close(master_);
  }

  SerialLine line(double late_answer_s = 1.0, int read_attempts = 1) const {
    SerialLine line;
    line.device = device_;
    line.late_answer_s = late_answer_s;
    line.read_attempts = read_attempts;
    return line;
  }

 private:
  void serve() {
    Bytes request;
    while (!stop_) {
      pollfd events{master_, POLLIN, 0};
      if (poll(&events, 1, 5) <= 0) continue;
      uint8_t byte;
      if (read(master_, &byte, 1) != 1) continue;
      request.push_back(byte);
      if (request.size() < 8) continue;
      answer_(request, [this](const Bytes& bytes) { (void)!write(master_, bytes.data(), bytes.size()); });
      request.clear();
    }
  }

  Answer answer_;
  int master_ = -1, slave_ = -1;
  std::string device_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace gantry
