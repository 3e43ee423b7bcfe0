// What a drive, or whoever sits at its address, may answer over Modbus. The first byte of an input chooses
// the drive and whether the rest stands for whole answers or only for the data of well-formed ones.

#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "fuzz.h"
#include "gantry/foundation/clock.h"
#include "gantry/hal/modbus_drives.h"
#include "gantry/hal/modbus_safety_inputs.h"

namespace gantry::fuzz {
namespace {

constexpr uint8_t kAz = 1, kWhole = 2, kStayOpen = 4, kCs2rs = 8, kKinco = 16;

/// Answers every request on a loopback port out of the bytes of the present input.
class Answerer {
 public:
  Answerer() : listener_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ::bind(listener_, reinterpret_cast<sockaddr*>(&address), size);
    ::listen(listener_, 16);
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    std::thread([this] { serve(); }).detach();  // for as long as the program runs
  }
  int port() const { return port_; }
  /// Only while no request is under way.
  void use(const uint8_t* data, size_t size) {
    flags_ = size > 0 ? data[0] : 0;
    bytes_.assign(data + (size > 0), data + size);
    next_ = 0;
  }

 private:
  uint8_t next() { return bytes_.empty() ? 0 : bytes_[next_++ % bytes_.size()]; }

  void serve() {
    for (;;) {
      const int client = ::accept(listener_, nullptr, nullptr);
      uint8_t request[300];
      for (ssize_t count; (count = ::recv(client, request, sizeof request, 0)) >= 12;) {
        const std::vector<uint8_t> reply = answer({request, request + count});
        ::send(client, reply.data(), reply.size(), MSG_NOSIGNAL);
        if (flags_ & kWhole && !(flags_ & kStayOpen)) break;
      }
      ::close(client);
    }
  }

  std::vector<uint8_t> answer(const std::vector<uint8_t>& request) {
    if (flags_ & kWhole) {
      std::vector<uint8_t> reply = bytes_;
      for (size_t i = 0; i < std::min<size_t>(2, reply.size()); ++i)
        reply[i] = request[i];  // the transaction
      return reply;
    }
    std::vector<uint8_t> reply(request.begin(), request.begin() + 12);
    if (request[7] == 3) {
      reply.resize(9);
      reply[8] = static_cast<uint8_t>(2 * request[11]);
      for (int i = 0; i < 2 * request[11]; ++i) reply.push_back(next());
    }
    if (request[7] == 2) {
      reply.resize(9);
      reply[8] = static_cast<uint8_t>((request[11] + 7) / 8);
      for (int i = 0; i < reply[8]; ++i) reply.push_back(next());
    }
    reply[5] = static_cast<uint8_t>(reply.size() - 6);
    return reply;
  }

  int listener_;
  int port_ = 0;
  std::atomic<uint8_t> flags_ = 0;
  std::vector<uint8_t> bytes_;
  size_t next_ = 0;
};

}  // namespace

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  const std::string status = "\0\0\x27\x10\0\0\0\0\0\0\x70\x18\0\0\0\0\0\0\0\0"s;
  const std::string whole = "\0\0\0\0\0\x17\1\3\x14"s + status;
  const auto with = [](uint8_t flags, const std::string& bytes) { return static_cast<char>(flags) + bytes; };
  return {with(0, status),
          with(kAz, status),
          with(kCs2rs, "\0\x62\0\0\x27\x10"s),
          with(kKinco, "\x94\x27\0\x21\0\0"s),
          with(kWhole, whole),
          with(kWhole | kStayOpen, "\0\0\0\0\0\3\1\x83\2"s),
          with(kAz | kWhole, "\0\0\0\0\0\7\1\3\4\0\0\0\x38"s),
          with(kWhole, "\0\0\0\0\0\6\1\5\4\x27\xff\0"s),
          with(kWhole, "\0\0\0\0\0\5\1\2\2\x3f\0"s)};
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  static auto* const answerer = new fuzz::Answerer;
  answerer->use(data, size);
  VirtualClock clock;
  ModbusDriveConfig config;
  config.axis = "fuzzed";
  config.host = "127.0.0.1";
  config.port = answerer->port();
  config.response_timeout_s = 0.02;
  if (size > 0 && data[0] & fuzz::kAz) {
    config.profile = "oriental_motor_az";
    config.kind = AxisKind::kRotary;
    config.counts_per_axis_unit = 5000;
  } else if (size > 0 && data[0] & (fuzz::kCs2rs | fuzz::kKinco)) {
    config.profile = data[0] & fuzz::kCs2rs ? "leadshine_cs2rs" : "kinco_fd";
    config.counts_per_axis_unit = 2000;
  } else {
    config.profile = "iai_robo_cylinder";
  }
  const auto drive = make_modbus_drive(config, nullptr, clock);
  // A Fault is a fine end of any of these.
  (void)drive->connect();
  (void)drive->read_status();
  (void)drive->set_servo(true);
  (void)drive->start_homing();
  (void)drive->start_move({10, 5, 100});
  (void)drive->read_status();
  (void)drive->halt();
  (void)drive->reset_alarm();
  ModbusSafetyInputsConfig inputs;
  inputs.host = config.host;
  inputs.port = config.port;
  inputs.channels = {3, 0, 13};
  inputs.response_timeout_s = 0.02;
  (void)make_modbus_safety_inputs(inputs, nullptr)->read();
  return 0;
}
