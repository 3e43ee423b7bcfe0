#include "serial_endpoint.h"

#include <fcntl.h>
#include <termios.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

namespace gantry {
namespace {

/// Half a frame that is not continued within this is forgotten, as silence on the line would have it.
constexpr double kForgetAfter_s = 0.05;

double real_time_s() {
  return SteadyClock().now_s();
}

}  // namespace

SerialEndpoint::~SerialEndpoint() {
  stop();
  if (master_.get() >= 0) remove_link();
}

std::string SerialEndpoint::device() const {
  std::lock_guard lock(device_mutex_);
  return device_;
}

void SerialEndpoint::remove_link() const {
  std::error_code ignored;
  if (!line_.link.empty() && std::filesystem::read_symlink(line_.link, ignored) == device())
    std::filesystem::remove(line_.link, ignored);
}

bool SerialEndpoint::plug() {
  Descriptor master(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK));
  std::array<char, 128> name{};
  if (master.get() < 0 || ::grantpt(master.get()) != 0 || ::unlockpt(master.get()) != 0 ||
      ::ptsname_r(master.get(), name.data(), name.size()) != 0)
    return false;
  Descriptor slave(::open(name.data(), O_RDWR | O_NOCTTY | O_CLOEXEC));
  termios mode{};
  if (slave.get() < 0 || ::tcgetattr(slave.get(), &mode) != 0) return false;
  ::cfmakeraw(&mode);
  if (::tcsetattr(slave.get(), TCSANOW, &mode) != 0) return false;
  if (!line_.link.empty()) {
    // Renamed into place, so that the link never points nowhere.
    const std::string temporary = line_.link.string() + ".new";
    std::error_code error;
    std::filesystem::remove(temporary, error);
    std::filesystem::create_symlink(name.data(), temporary, error);
    if (!error) std::filesystem::rename(temporary, line_.link, error);
    if (error) {
      errno = error.value();
      return false;
    }
  }
  master_ = std::move(master);
  slave_ = std::move(slave);
  received_.clear();
  std::lock_guard lock(device_mutex_);
  device_ = name.data();
  return true;
}

void SerialEndpoint::unplug() {
  remove_link();
  replies_.clear();
  slave_ = Descriptor();
  master_ = Descriptor();
  std::lock_guard lock(device_mutex_);
  device_.clear();
}

void SerialEndpoint::start() {
  std::error_code ignored;
  const auto status = std::filesystem::symlink_status(line_.link, ignored);
  if (!line_.link.empty() && std::filesystem::exists(status) && !std::filesystem::is_symlink(status))
    throw InputError("Modbus twin: " + line_.link.string() +
                     " exists and is no symbolic link; the twin's serial line is not put in its place");
  if (!plug())
    throw InputError("Modbus twin: cannot make the serial line " + line_.link.string() + ": " +
                     std::strerror(errno));
  prepare();
  run();
}

void SerialEndpoint::serve() {
  for (;;) {
    std::array<pollfd, 2> polled{{{wake_descriptor(), POLLIN, 0}, {master_.get(), POLLIN, 0}}};
    if (replies_.poll(polled, real_time_s()) < 0 && errno != EINTR) return;
    if (polled[0].revents) {
      const Wish wanted = wish();
      if (wanted.stop) return;
      if (!wanted.plugged) unplug();
      if (wanted.plugged && master_.get() < 0) plug();
      done(wanted.plugged);
      continue;
    }
    if (polled[1].revents && !receive()) return;
    while (const auto reply = replies_.pop(real_time_s())) {
      // The line's buffer is large, and nobody reads by itself what is too much for it.
      [[maybe_unused]] const ssize_t written =
          ::write(master_.get(), reply->frame.data(), reply->frame.size());
    }
  }
}

bool SerialEndpoint::receive() {
  std::array<uint8_t, 512> chunk;
  const ssize_t count = ::read(master_.get(), chunk.data(), chunk.size());
  if (count < 0) return errno == EAGAIN || errno == EINTR || errno == EIO;
  const double now_s = real_time_s();
  if (now_s - received_at_s_ > kForgetAfter_s) received_.clear();
  received_at_s_ = now_s;
  received_.insert(received_.end(), chunk.begin(), chunk.begin() + count);

  std::span<const uint8_t> rest(received_);
  ModbusFrame frame = first_rtu_request(rest);
  while (frame.state == ModbusFrame::State::kComplete) {
    const auto request = rest.first(frame.length);
    const int unit = request[0];
    if (const auto reply = bank_.answer(unit, request.subspan(1, request.size() - 3), false)) {
      const std::vector<uint8_t> bytes = rtu_reply(request, reply->pdu);
      const double on_line_s = line_.honest_wire_time
                                   ? static_cast<double>((request.size() + bytes.size()) * 11) / line_.baud +
                                         std::max(1.75e-3, 38.5 / line_.baud)
                                   : 0.0;
      replies_.push(bank_, *reply, unit, 0, bytes, bytes.size(), now_s + on_line_s);
    }
    rest = rest.subspan(frame.length);
    frame = first_rtu_request(rest);
  }
  received_.assign(rest.begin(), rest.end());
  if (frame.state == ModbusFrame::State::kNotModbus) received_.clear();
  return true;
}

}  // namespace gantry
