// What a client may send to the twin's Modbus drives: a stream of TCP bytes.

#include <sys/socket.h>
#include <unistd.h>

#include <numbers>

#include "fuzz.h"
#include "gantry/foundation/clock.h"
#include "twin/modbus/iai_robo_cylinder.h"
#include "twin/modbus/io_module.h"
#include "twin/modbus/modbus_gateway.h"
#include "twin/modbus/oriental_motor_az.h"

namespace gantry::fuzz {
namespace {

std::string frame(const std::string& unit_and_pdu) {
  return std::string("\0\1\0\0\0", 5) + static_cast<char>(unit_and_pdu.size()) + unit_and_pdu;
}

}  // namespace

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  return {
      frame("\1\3\x90\0\0\x0a"s) + frame("\1\5\4\3\xff\0"s),  // IAI: status, servo on
      frame("\1\x10\x99\0\0\x09\x12\0\0\x27\x10\0\0\0\x0a\0\0\x27\x10\0\x1e\0\0\0\0"s),  // IAI: move
      frame("\2\3\0\x7e\0\2"s) + frame("\2\6\0\x7d\0\x10"s),                             // AZ: status, input
      frame("\2\x10\0\x58\0\x10\x20"s + std::string(31, '\0') + "\1"s),                  // AZ: direct data
      frame("\4\2\0\0\0\x10"s) + frame("\4\2\0\x0f\0\1"s),  // I/O module: all inputs, the last one
      frame("\3\3\0\0\0\1"s) + frame("\1\x2b\x0e\1\0"s),
  };
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  SimulatedStage linear({.travel_min = 0, .travel_max = 300, .max_speed = 200, .max_acceleration = 1000}, 1);
  SimulatedStage rotary({.travel_min = -3, .travel_max = 3, .max_speed = 2, .max_acceleration = 10}, 2);
  TwinDrives drives;
  double now_s = 1;
  drives.emplace(1, std::make_unique<IaiRoboCylinder>(linear));
  VirtualClock clock;
  const SafetyContacts contacts({{"emergency stop", {0, 1}}, {"door", {15}}}, clock);
  drives.emplace(4, std::make_unique<IoModule>(contacts));
  drives.emplace(2, std::make_unique<OrientalMotorAz>(rotary, std::numbers::pi / 18000, now_s));

  int sockets[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, sockets) != 0) return 0;
  static modbus_t* const context = modbus_new_tcp("127.0.0.1", 1502);
  modbus_set_socket(context, sockets[0]);
  std::span<const uint8_t> rest(data, size);
  for (;;) {
    const ModbusFrame frame = first_modbus_frame(rest);
    if (frame.state != ModbusFrame::State::kComplete) break;
    // In memory of its own, so that a byte read behind the frame's end shows.
    const std::vector<uint8_t> bytes(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(frame.length));
    answer_modbus_request(context, bytes, drives, now_s);
    char answer[512];
    while (::recv(sockets[1], answer, sizeof answer, 0) > 0) {
    }
    rest = rest.subspan(frame.length);
    now_s += 0.3;
  }
  ::close(sockets[0]);
  ::close(sockets[1]);
  return 0;
}
