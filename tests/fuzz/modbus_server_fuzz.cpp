// What a client may send to the twin's Modbus drives: a stream of bytes on TCP or on a serial line. The first
// byte of an input chooses which.

#include <numbers>

#include "fuzz.h"
#include "gantry/foundation/clock.h"
#include "twin/modbus/iai_robo_cylinder.h"
#include "twin/modbus/io_module.h"
#include "twin/modbus/kinco_fd.h"
#include "twin/modbus/leadshine_cs2rs.h"
#include "twin/modbus/modbus_gateway.h"
#include "twin/modbus/oriental_motor_az.h"

namespace gantry::fuzz {
namespace {

constexpr char kTcp = 'T', kSerial = 'S';

std::string frame(const std::string& unit_and_pdu) {
  return std::string("\0\1\0\0\0", 5) + static_cast<char>(unit_and_pdu.size()) + unit_and_pdu;
}

}  // namespace

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  const std::string tcp(1, kTcp), serial(1, kSerial);
  return {
      tcp + frame("\1\3\x90\0\0\x0a"s) + frame("\1\5\4\3\xff\0"s),  // IAI: status, servo on
      tcp + frame("\1\x10\x99\0\0\x09\x12\0\0\x27\x10\0\0\0\x0a\0\0\x27\x10\0\x1e\0\0\0\0"s),  // IAI: move
      tcp + frame("\2\3\0\x7e\0\2"s) + frame("\2\6\0\x7d\0\x10"s),             // AZ: status, input
      tcp + frame("\2\x10\0\x58\0\x10\x20"s + std::string(31, '\0') + "\1"s),  // AZ: direct data
      tcp + frame("\3\6\0\x0f\0\1"s) + frame("\3\6\x60\2\0\x20"s),             // CS2RS: enable, home
      tcp + frame("\3\x10\x62\0\0\x08\x10\0\1\0\0\x27\x10\0\xc8\0\x64\0\x64\0\0\0\x10"s),  // CS2RS: path
      tcp + frame("\4\6\x31\0\0\6"s) + frame("\4\6\x31\0\0\7"s) + frame("\4\6\x31\0\0\x0f"s) +
          frame("\4\x10\x40\0\0\2\4\x55\x55\0\x08"s) + frame("\4\6\x31\0\0\x3f"s),  // Kinco: power, move
      tcp + frame("\6\2\0\0\0\x10"s) + frame("\6\2\0\x0f\0\1"s),  // I/O module: all inputs, the last one
      tcp + frame("\5\3\0\0\0\1"s) + frame("\1\x2b\x0e\1\0"s),
      serial + "\1\6\x0d\3\0\1\xba\xa6"s + "\4\3\x32\0\0\2\xca\xe6"s,
      serial + "\7\x10\x62\0\0\x08\x10\0\1\0\0\x27\x10\0\0\x27\x10\x27\x10\0\0\0\x10\x8d\x50"s,
  };
}

}  // namespace gantry::fuzz

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace gantry;
  if (size == 0) return 0;
  SimulatedStage linear({.travel_min = 0, .travel_max = 300, .max_speed = 200, .max_acceleration = 1000}, 1);
  SimulatedStage rotary({.travel_min = -3, .travel_max = 3, .max_speed = 2, .max_acceleration = 10}, 2);
  SimulatedStage more[] = {{{.travel_max = 300, .max_speed = 200, .max_acceleration = 1000}, 3},
                           {{.travel_max = 300, .max_speed = 200, .max_acceleration = 1000}, 4}};
  TwinDrives drives;
  double now_s = 1;
  drives.emplace(1, std::make_unique<IaiRoboCylinder>(linear));
  drives.emplace(2, std::make_unique<OrientalMotorAz>(rotary, std::numbers::pi / 18000, now_s, 0x1000));
  drives.emplace(3, std::make_unique<LeadshineCs2rs>(more[0], 0.001));
  drives.emplace(4, std::make_unique<KincoFd>(more[1], 0.0001));
  VirtualClock clock;
  const SafetyContacts contacts({{"emergency stop", {0, 1}}, {"door", {15}}}, clock);
  drives.emplace(6, std::make_unique<IoModule>(contacts));

  const bool serial = data[0] == 'S';
  std::span<const uint8_t> rest(data + 1, size - 1);
  for (;;) {
    const ModbusFrame frame = serial ? first_rtu_request(rest) : first_tcp_request(rest);
    if (frame.state != ModbusFrame::State::kComplete) break;
    // In memory of its own, so that a byte read behind the frame's end shows.
    const std::vector<uint8_t> bytes(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(frame.length));
    const std::span<const uint8_t> whole(bytes);
    const auto drive = drives.find(serial ? bytes[0] : bytes[6]);
    if (drive != drives.end()) {
      const auto pdu = serial ? whole.subspan(1, whole.size() - 3) : whole.subspan(7);
      const auto answer = answer_request(*drive->second, pdu, now_s);
      if (answer.size() < 2 || answer.size() > 253) throw std::logic_error("no PDU");
      const auto reply = serial ? rtu_reply(whole, answer) : tcp_reply(whole, answer);
      if (reply.size() <= answer.size()) throw std::logic_error("no frame");
    }
    rest = rest.subspan(frame.length);
    now_s += 0.3;
  }
  return 0;
}
