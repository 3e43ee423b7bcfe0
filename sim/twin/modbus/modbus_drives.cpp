#include "gantry/sim/twin/modbus_drives.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <map>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "gantry/foundation/error.h"
#include "iai_robo_cylinder.h"
#include "io_module.h"
#include "modbus_gateway.h"
#include "oriental_motor_az.h"

namespace gantry {
namespace {

constexpr size_t kMaxClients = 32;
constexpr double kIaiMmPerCount = 0.01;

/// A file descriptor that closes itself.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }

 private:
  int fd_ = -1;
};

struct Client {
  Descriptor socket;
  std::vector<uint8_t> received;
};

std::unique_ptr<TwinDrive> make_drive(const TwinDriveConfig& config, SimulatedStage& stage, double now_s) {
  const std::string unit = "Modbus unit " + std::to_string(config.unit);
  if (config.profile == "iai_robo_cylinder") {
    if (config.axis_units_per_count != kIaiMmPerCount)
      throw InputError(unit + ": an IAI ROBO Cylinder counts 0.01 mm, found axis_units_per_count " +
                       std::to_string(config.axis_units_per_count));
    return std::make_unique<IaiRoboCylinder>(stage);
  }
  if (config.profile == "oriental_motor_az") {
    if (!(config.axis_units_per_count > 0))
      throw InputError(unit + ": axis_units_per_count must be positive, found " +
                       std::to_string(config.axis_units_per_count));
    return std::make_unique<OrientalMotorAz>(stage, config.axis_units_per_count, now_s);
  }
  throw InputError(unit + ": unknown drive profile '" + config.profile +
                   "', expected iai_robo_cylinder or oriental_motor_az");
}

}  // namespace

class ModbusDriveServer::Impl {
 public:
  Impl(std::string address, int port, Clock& clock)
      : address_(std::move(address)), port_(port), clock_(clock), context_(nullptr, &modbus_free) {
    if (::inet_pton(AF_INET, address_.c_str(), &ip_) != 1 || ntohl(ip_.s_addr) >> 24 != IN_LOOPBACKNET)
      throw InputError("Modbus twin: address '" + address_ + "' is not a loopback address like 127.0.0.1");
    if (port < 0 || port > 65535)
      throw InputError("Modbus twin: port " + std::to_string(port) + " is not within 0 to 65535");
  }

  ~Impl() {
    if (!thread_.joinable()) return;
    const uint64_t one = 1;
    // An eventfd at zero always takes a one.
    [[maybe_unused]] const ssize_t written = ::write(wake_.get(), &one, sizeof one);
    thread_.join();
  }

  void add(const TwinDriveConfig& config, SimulatedStage& stage) {
    add_unit(config.unit, [&] { return make_drive(config, stage, clock_.now_s()); });
  }

  void add_io_module(int unit, const SafetyContacts& contacts) {
    add_unit(unit, [&] { return std::make_unique<IoModule>(contacts); });
  }

  void start() {
    Descriptor listener(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int yes = 1;
    ::setsockopt(listener.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in endpoint{};
    endpoint.sin_family = AF_INET;
    endpoint.sin_addr = ip_;
    endpoint.sin_port = htons(static_cast<uint16_t>(port_));
    if (::bind(listener.get(), reinterpret_cast<sockaddr*>(&endpoint), sizeof endpoint) != 0 ||
        ::listen(listener.get(), SOMAXCONN) != 0)
      throw InputError("Modbus twin: cannot listen at " + name() + ": " + std::strerror(errno));
    socklen_t size = sizeof endpoint;
    ::getsockname(listener.get(), reinterpret_cast<sockaddr*>(&endpoint), &size);
    port_ = ntohs(endpoint.sin_port);

    context_.reset(modbus_new_tcp(address_.c_str(), port_));
    wake_ = Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
    if (!context_ || wake_.get() < 0)
      throw InputError("Modbus twin: cannot serve " + name() + ": " + std::strerror(errno));
    listener_ = std::move(listener);
    thread_ = std::thread([this] { serve(); });
  }

  int port() const { return port_; }

  /// Calls `action(drive, now_s)`; for the fault injection.
  template <typename Action>
  void with_drive(int unit, Action action) {
    std::lock_guard lock(mutex_);
    const auto drive = drives_.find(unit);
    if (drive == drives_.end())
      throw InputError("Modbus twin: no drive has unit " + std::to_string(unit) + " at " + name());
    action(*drive->second, clock_.now_s());
  }

 private:
  std::string name() const { return address_ + ":" + std::to_string(port_); }

  template <typename Make>
  void add_unit(int unit, Make make) {
    if (unit < 1 || unit > 247)
      throw InputError("Modbus unit " + std::to_string(unit) + " is not within 1 to 247");
    std::lock_guard lock(mutex_);
    if (drives_.contains(unit))
      throw InputError("Modbus unit " + std::to_string(unit) + " is used twice at " + name());
    drives_.emplace(unit, make());
  }

  void serve() {
    for (;;) {
      // At the limit, newcomers wait in the backlog until somebody leaves; poll() skips a negative
      // descriptor.
      const int accepting = clients_.size() < kMaxClients ? listener_.get() : -1;
      std::vector<pollfd> polled{{wake_.get(), POLLIN, 0}, {accepting, POLLIN, 0}};
      for (const Client& client : clients_) polled.push_back({client.socket.get(), POLLIN, 0});
      if (::poll(polled.data(), polled.size(), -1) < 0 && errno != EINTR) return;
      if (polled[0].revents) return;
      std::vector<Client> kept;
      for (size_t i = 0; i < clients_.size(); ++i) {
        if (!polled[i + 2].revents || serve_client(clients_[i])) kept.push_back(std::move(clients_[i]));
      }
      clients_ = std::move(kept);
      if (polled[1].revents) accept_clients();
    }
  }

  void accept_clients() {
    while (clients_.size() < kMaxClients) {
      Descriptor socket(::accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (socket.get() < 0) return;
      const int yes = 1;
      ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
      clients_.push_back({std::move(socket), {}});
    }
  }

  /// False when the connection has ended, or is to be closed because it talks nonsense or does not read.
  bool serve_client(Client& client) {
    std::array<uint8_t, 4096> chunk;
    const ssize_t count = ::recv(client.socket.get(), chunk.data(), chunk.size(), 0);
    if (count == 0) return false;
    if (count < 0) return errno == EAGAIN || errno == EINTR;
    client.received.insert(client.received.end(), chunk.begin(), chunk.begin() + count);

    modbus_set_socket(context_.get(), client.socket.get());
    std::span<const uint8_t> rest(client.received);
    ModbusFrame frame = first_modbus_frame(rest);
    while (frame.state == ModbusFrame::State::kComplete) {
      std::lock_guard lock(mutex_);
      if (!answer_modbus_request(context_.get(), rest.first(frame.length), drives_, clock_.now_s()))
        return false;
      rest = rest.subspan(frame.length);
      frame = first_modbus_frame(rest);
    }
    client.received.assign(rest.begin(), rest.end());
    return frame.state != ModbusFrame::State::kNotModbus;
  }

  const std::string address_;
  in_addr ip_{};
  int port_;
  Clock& clock_;
  std::unique_ptr<modbus_t, decltype(&modbus_free)> context_;  ///< Only builds and sends replies.
  Descriptor listener_;
  Descriptor wake_;
  std::vector<Client> clients_;  ///< Of the serving thread.
  std::mutex mutex_;             ///< Guards the drives.
  TwinDrives drives_;
  std::thread thread_;
};

ModbusDriveServer::ModbusDriveServer(std::string address, int port, Clock& clock)
    : impl_(std::make_unique<Impl>(std::move(address), port, clock)) {}
ModbusDriveServer::~ModbusDriveServer() = default;

void ModbusDriveServer::add(const TwinDriveConfig& config, SimulatedStage& stage) {
  impl_->add(config, stage);
}
void ModbusDriveServer::add_io_module(int unit, const SafetyContacts& contacts) {
  impl_->add_io_module(unit, contacts);
}
void ModbusDriveServer::start() {
  impl_->start();
}
int ModbusDriveServer::port() const {
  return impl_->port();
}

void ModbusDriveServer::raise_alarm(int unit, int code, AlarmCause cause) {
  impl_->with_drive(unit, [&](TwinDrive& drive, double now_s) {
    drive.raise_alarm(code, cause == AlarmCause::kPersists, now_s);
  });
}
void ModbusDriveServer::clear_alarm_cause(int unit) {
  impl_->with_drive(unit, [](TwinDrive& drive, double) { drive.clear_alarm_cause(); });
}
void ModbusDriveServer::set_emergency_stop(int unit, bool active) {
  impl_->with_drive(unit, [&](TwinDrive& drive, double now_s) { drive.set_emergency_stop(active, now_s); });
}

}  // namespace gantry
