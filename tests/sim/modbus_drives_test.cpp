// The frames are written by hand from the manuals quoted in docs/modbus-drives.md, as hexadecimal PDUs.
#include "gantry/sim/twin/modbus_drives.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <numbers>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "gantry/foundation/error.h"

namespace gantry {
namespace {

using Bytes = std::vector<uint8_t>;

constexpr double kRadPerStep = 2 * std::numbers::pi / 36000;  // 0.01 degrees

Bytes bytes(const std::string& hex) {
  std::istringstream in(hex);
  Bytes result;
  for (unsigned byte; in >> std::hex >> byte;) result.push_back(static_cast<uint8_t>(byte));
  return result;
}

std::string hex(const Bytes& data) {
  std::string text;
  char digits[4];
  for (const uint8_t byte : data) {
    std::snprintf(digits, sizeof digits, "%s%02X", text.empty() ? "" : " ", byte);
    text += digits;
  }
  return text;
}

std::string hex16(int value) {
  return hex({static_cast<uint8_t>(value >> 8), static_cast<uint8_t>(value & 0xFF)});
}
/// Upper word first.
std::string hex32(int64_t value) {
  const auto bits = static_cast<uint32_t>(static_cast<int32_t>(value));
  return hex16(static_cast<int>(bits >> 16)) + " " + hex16(static_cast<int>(bits & 0xFFFF));
}

/// A raw TCP connection with a deadline, so that a hanging server fails the test.
class Connection {
 public:
  explicit Connection(int port) : fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in endpoint{};
    endpoint.sin_family = AF_INET;
    endpoint.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    endpoint.sin_port = htons(static_cast<uint16_t>(port));
    const timeval deadline{5, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &deadline, sizeof deadline);
    const int yes = 1;
    ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    EXPECT_EQ(::connect(fd_, reinterpret_cast<sockaddr*>(&endpoint), sizeof endpoint), 0);
  }
  ~Connection() { ::close(fd_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void send(const Bytes& data) { ::send(fd_, data.data(), data.size(), MSG_NOSIGNAL); }
  /// Up to `count` bytes; fewer when the server closes the connection or the deadline passes.
  Bytes receive(size_t count) {
    Bytes data(count);
    size_t have = 0;
    while (have < count) {
      const ssize_t got = ::recv(fd_, data.data() + have, count - have, 0);
      if (got <= 0) break;
      have += static_cast<size_t>(got);
    }
    data.resize(have);
    return data;
  }
  /// Whether the server ends the connection before the deadline.
  bool closed_by_server() {
    uint8_t byte;
    const ssize_t got = ::recv(fd_, &byte, 1, 0);
    return got == 0 || (got < 0 && errno == ECONNRESET);
  }
  /// One whole frame.
  Bytes receive_frame() {
    Bytes frame = receive(6);
    if (frame.size() < 6) return frame;
    const Bytes rest = receive(static_cast<size_t>(frame[4] << 8 | frame[5]));
    frame.insert(frame.end(), rest.begin(), rest.end());
    return frame;
  }
  /// The reply's PDU; checks transaction, protocol, length and unit.
  std::string ask(int unit, const std::string& pdu) {
    const Bytes body = bytes(pdu);
    ++transaction_;
    Bytes frame = bytes(hex16(transaction_) + " 00 00 " + hex16(static_cast<int>(body.size()) + 1));
    frame.push_back(static_cast<uint8_t>(unit));
    frame.insert(frame.end(), body.begin(), body.end());
    send(frame);
    const Bytes reply = receive_frame();
    if (reply.size() < 8) return "no reply";
    EXPECT_EQ(hex({reply.begin(), reply.begin() + 4}), hex16(transaction_) + " 00 00");
    EXPECT_EQ(reply[4] << 8 | reply[5], static_cast<int>(reply.size()) - 6);
    EXPECT_EQ(reply[6], unit);
    return hex({reply.begin() + 7, reply.end()});
  }
  std::vector<int> read(int unit, int address, int count) {
    const Bytes reply = bytes(ask(unit, "03 " + hex16(address) + " " + hex16(count)));
    std::vector<int> words(static_cast<size_t>(count), -1);
    EXPECT_EQ(reply.size(), 2 + 2 * words.size()) << hex(reply);
    for (size_t i = 0; i < words.size() && 3 + 2 * i < reply.size(); ++i)
      words[i] = reply[2 + 2 * i] << 8 | reply[3 + 2 * i];
    return words;
  }
  int32_t read32(int unit, int address) {
    const auto words = read(unit, address, 2);
    return static_cast<int32_t>(static_cast<uint32_t>(words[0]) << 16 | static_cast<uint32_t>(words[1]));
  }
  /// Sends a write that must be echoed the way its function demands.
  void write(int unit, const std::string& pdu) {
    const std::string reply = ask(unit, pdu);
    EXPECT_EQ(reply, pdu.substr(0, 2) == "10" ? pdu.substr(0, 14) : pdu);
  }

 private:
  int fd_;
  int transaction_ = 0x1200;
};

constexpr int kIai = 1;
constexpr int kAz = 2;

class ModbusDrives : public ::testing::Test {
 protected:
  ModbusDrives() {
    server_.add({"iai_robo_cylinder", kIai, 0.01}, linear_);
    server_.add({"oriental_motor_az", kAz, kRadPerStep}, tilt_);
    server_.start();
  }

  // IAI
  int status() { return client().read(kIai, 0x9005, 1)[0]; }
  bool moving() { return client().read(kIai, 0x9007, 1)[0] >> 5 & 1; }
  int alarm() { return client().read(kIai, 0x9002, 1)[0]; }
  int position() { return client().read32(kIai, 0x9000); }
  void coil(int address, bool on) {
    client().write(kIai, "05 " + hex16(address) + (on ? " FF 00" : " 00 00"));
  }
  /// The whole block at 9900, 150 mm/s and 0.30 G.
  void move(int target, int band = 2, int flags = 0) {
    client().write(kIai, "10 99 00 00 09 12 " + hex32(target) + " " + hex32(band) + " " + hex32(15000) + " " +
                             hex16(30) + " 00 00 " + hex16(flags));
  }
  void home_linear() {
    coil(0x0403, true);
    coil(0x040B, false);
    coil(0x040B, true);
    ASSERT_TRUE(until([&] { return status() >> 4 & 1 && !moving(); }));
    coil(0x040B, false);
  }

  // AZ
  int outputs() { return client().read(kAz, 0x007F, 1)[0]; }
  bool output(int number) { return outputs() >> number & 1; }
  void inputs(int word) { client().write(kAz, "10 00 7C 00 02 04 00 00 " + hex16(word)); }
  static std::string direct(int type, int64_t position, int speed = 2000, int trigger = 1) {
    return "10 00 58 00 10 20 " + hex32(0) + " " + hex32(type) + " " + hex32(position) + " " + hex32(speed) +
           " " + hex32(5000) + " " + hex32(5000) + " " + hex32(1000) + " " + hex32(trigger);
  }
  int32_t az_alarm() { return client().read32(kAz, 0x0080); }
  int32_t steps() { return client().read32(kAz, 0x0120); }
  bool az_standstill() {
    return until([&] { return !output(13); });
  }
  void home_tilt() {
    inputs(0);
    inputs(1 << 4);
    ASSERT_TRUE(until([&] { return output(4) && !output(13); }));
    inputs(0);
  }

  /// Advances the clock until the condition holds, for at most a minute of its time.
  template <typename Condition>
  bool until(Condition condition) {
    for (int i = 0; i < 3000; ++i) {
      if (condition()) return true;
      clock_.sleep_s(0.02);
    }
    return false;
  }

  Connection& client() {
    if (!client_) client_ = std::make_unique<Connection>(server_.port());
    return *client_;
  }

  VirtualClock clock_;
  SimulatedStage linear_{{-200, 300, 200, 2000, 50, 0.01, 0.002, 0.15}, 7};
  SimulatedStage tilt_{{-1.0, 1.2, 1.0, 5.0, 0.3, kRadPerStep, 1e-5, 0.15}, 8};
  ModbusDriveServer server_{"127.0.0.1", 0, clock_};
  std::unique_ptr<Connection> client_;
};

TEST_F(ModbusDrives, GoldenFramesOfTheIaiManual) {
  // 5.3.8: present alarm code, as a whole Modbus TCP frame.
  client().send(bytes("00 2A 00 00 00 06 01 03 90 02 00 01"));
  EXPECT_EQ(hex(client().receive_frame()), "00 2A 00 00 00 05 01 03 02 00 00");
  // 5.4.7: home return. The servo is off, so that nothing happens but alarm 080.
  EXPECT_EQ(client().ask(kIai, "05 04 0B 00 00"), "05 04 0B 00 00");
  EXPECT_EQ(client().ask(kIai, "05 04 0B FF 00"), "05 04 0B FF 00");
  EXPECT_EQ(client().ask(kIai, "03 90 02 00 01"), "03 02 00 80");
  // Reset, then 5.5: RTU 01 06 0D 03 00 01 BA A6. The position table is empty.
  coil(0x0407, true);
  coil(0x0407, false);
  EXPECT_EQ(client().ask(kIai, "06 0D 03 00 01"), "06 0D 03 00 01");
  EXPECT_EQ(client().ask(kIai, "03 90 02 00 01"), "03 02 00 A2");
}

TEST_F(ModbusDrives, GoldenFramesOfTheAz) {
  // Power-on: energised, hence READY and IN-POS, nothing else.
  EXPECT_EQ(client().ask(kAz, "03 00 7E 00 02"), "03 04 00 00 40 20");
  // -1 is FFFF FFFF, upper word at the even address.
  client().write(kAz, "10 00 5C 00 02 04 FF FF FF FE");
  EXPECT_EQ(client().ask(kAz, "03 00 5C 00 02"), "03 04 FF FF FF FE");
  client().write(kAz, "10 00 5C 00 02 04 00 01 86 A0");  // 100000
  EXPECT_EQ(client().ask(kAz, "03 00 5C 00 01"), "03 02 00 01");
  EXPECT_EQ(client().ask(kAz, "03 00 5D 00 01"), "03 02 86 A0");
}

TEST_F(ModbusDrives, IaiHomesAndMovesToEveryTargetWithinOneCount) {
  home_linear();
  EXPECT_LE(std::abs(position()), 1);
  std::mt19937 random(1);
  std::uniform_int_distribution<int> anywhere(-20000, 30000);
  for (int i = 0; i < 25; ++i) {
    const int target = i == 0 ? -20000 : i == 1 ? 30000 : anywhere(random);
    move(target);
    ASSERT_TRUE(until([&] { return !moving(); }));
    EXPECT_LE(std::abs(position() - target), 1);
    EXPECT_EQ(status(), 0x3018);  // ready, servo on, homed, in position
    EXPECT_NEAR(linear_.observe(clock_.now_s()).true_position, target * 0.01, 0.02);
  }
}

TEST_F(ModbusDrives, IaiNegativePositionOnTheWire) {
  home_linear();
  move(-12345);
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(client().ask(kIai, "03 90 00 00 02"), "03 04 FF FF CF C7");
}

TEST_F(ModbusDrives, IaiSeparateWritesMoveAsOneBlockDoes) {
  home_linear();
  client().write(kIai, "10 99 02 00 02 04 00 00 00 05");
  client().write(kIai, "10 99 04 00 02 04 00 00 27 10");  // 100 mm/s
  client().write(kIai, "06 99 06 00 1E");
  EXPECT_FALSE(moving());
  client().write(kIai, "10 99 00 00 02 04 00 00 13 88");  // 50 mm
  EXPECT_TRUE(moving());
  clock_.sleep_s(0.25);
  EXPECT_EQ(client().read32(kIai, 0x900A), 10000);
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(position(), 5000);
  EXPECT_EQ(client().read(kIai, 0x9900, 9), (std::vector<int>{0, 5000, 0, 5, 0, 10000, 30, 0, 0}));
}

TEST_F(ModbusDrives, IaiSpeedAndAccelerationAreInTheManualsUnits) {
  home_linear();
  move(20000);  // 0.30 G = 2942 mm/s^2, clipped to 2000: 150 mm/s after 75 ms
  clock_.sleep_s(0.0375);
  EXPECT_NEAR(client().read32(kIai, 0x900A), 7500, 1);
  clock_.sleep_s(0.1);
  EXPECT_EQ(client().read32(kIai, 0x900A), 15000);
  // A new speed alone changes the speed of the running move, not its target.
  client().write(kIai, "10 99 04 00 02 04 00 00 03 E8");
  clock_.sleep_s(0.1);
  EXPECT_EQ(client().read32(kIai, 0x900A), 1000);
  client().write(kIai, "10 99 04 00 02 04 00 00 4E 20");
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(position(), 20000);
}

TEST_F(ModbusDrives, IaiRefusesUnsafeMovesWithAnAlarm) {
  const double start = linear_.observe(0).true_position;
  move(1000);
  EXPECT_EQ(alarm(), 0x080);  // servo off
  EXPECT_EQ(status(), 0x2400);
  coil(0x0403, true);
  EXPECT_EQ(status() >> 12 & 1, 0) << "no servo on while an alarm is pending";
  coil(0x0407, true);
  coil(0x0407, false);
  coil(0x0403, true);
  move(1000);
  EXPECT_EQ(alarm(), 0x083);  // not homed
  EXPECT_EQ(status() >> 12 & 1, 0) << "an alarm drops the servo";
  EXPECT_FALSE(moving());
  EXPECT_EQ(linear_.observe(clock_.now_s()).true_position, start);

  coil(0x0407, true);
  coil(0x0407, false);
  home_linear();
  for (const int target : {-20001, 30001, 2147483647, -2147483647 - 1}) {
    move(target);
    EXPECT_EQ(alarm(), 0x0A3) << target;
    EXPECT_FALSE(moving());
    coil(0x0407, true);
    coil(0x0407, false);
    coil(0x0403, true);
    EXPECT_EQ(status() >> 4 & 1, 1) << "an alarm does not lose home";
  }
  client().write(kIai, "10 99 00 00 06 0C 00 00 00 64 00 00 00 02 00 00 00 00");  // speed 0
  EXPECT_EQ(alarm(), 0x0A3);
}

TEST_F(ModbusDrives, IaiIncrementalMoveCountsFromTheTargetAndItsFlagIsUsedUp) {
  home_linear();
  move(1000);
  ASSERT_TRUE(until([&] { return !moving(); }));
  move(-300, 2, 1 << 3);
  EXPECT_EQ(client().read(kIai, 0x9908, 1)[0], 0);
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(position(), 700);
  move(-300);
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(position(), -300);
}

TEST_F(ModbusDrives, IaiHomeNeedsARisingEdge) {
  coil(0x0403, true);
  coil(0x040B, true);
  ASSERT_TRUE(until([&] { return status() >> 4 & 1; }));
  coil(0x040B, true);  // still on: no edge, no second homing
  EXPECT_EQ(status() >> 4 & 1, 1);
  coil(0x040B, false);
  move(2000);
  ASSERT_TRUE(until([&] { return !moving(); }));
  coil(0x040B, true);
  EXPECT_EQ(status() >> 4 & 1, 0);
  EXPECT_EQ(client().read(kIai, 0x9007, 1)[0] >> 11 & 1, 1);  // GHMS
  ASSERT_TRUE(until([&] { return status() >> 4 & 1; }));
  EXPECT_LE(std::abs(position()), 1);
}

TEST_F(ModbusDrives, IaiPauseKeepsTheRemainingTravel) {
  home_linear();
  move(10000);
  clock_.sleep_s(0.3);
  coil(0x040A, true);
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(status(), 0x3030);  // paused, not in position
  EXPECT_GT(position(), 0);
  EXPECT_LT(position(), 9000);
  coil(0x040A, false);
  EXPECT_TRUE(moving());
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(position(), 10000);

  // An alarm reset during the pause cancels it.
  move(0);
  clock_.sleep_s(0.3);
  coil(0x040A, true);
  ASSERT_TRUE(until([&] { return !moving(); }));
  coil(0x0407, true);
  coil(0x0407, false);
  const int here = position();
  coil(0x040A, false);
  EXPECT_FALSE(moving());
  EXPECT_EQ(position(), here);
  // While paused a move waits.
  coil(0x040A, true);
  move(4000);
  EXPECT_FALSE(moving());
  coil(0x040A, false);
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(position(), 4000);
}

TEST_F(ModbusDrives, IaiPauseRepeatsAnInterruptedHomeReturn) {
  coil(0x0403, true);
  coil(0x040B, true);
  clock_.sleep_s(0.1);
  coil(0x040A, true);
  ASSERT_TRUE(until([&] { return !moving(); }));
  clock_.sleep_s(30);
  EXPECT_EQ(status() >> 4 & 1, 0);
  coil(0x040A, false);
  ASSERT_TRUE(until([&] { return status() >> 4 & 1; }));
  EXPECT_LE(std::abs(position()), 1);
}

TEST_F(ModbusDrives, IaiDecelerationStopForgetsTheTravel) {
  home_linear();
  move(10000);
  clock_.sleep_s(0.3);
  coil(0x042C, true);
  ASSERT_TRUE(until([&] { return !moving(); }));
  EXPECT_EQ(status(), 0x3010);                                  // homed, not in position
  EXPECT_EQ(client().ask(kIai, "01 04 2C 00 01"), "01 01 00");  // back to 0 by itself
  EXPECT_LT(position(), 9000);
}

TEST_F(ModbusDrives, IaiInPositionPrecedesTheEndOfMotionWhenTheBandIsWide) {
  home_linear();
  move(10000, 2000);
  EXPECT_EQ(status() >> 3 & 1, 0);
  ASSERT_TRUE(until([&] { return status() >> 3 & 1; }));
  EXPECT_LT(position(), 9800);
  EXPECT_GE(position(), 8000);
  EXPECT_TRUE(moving());
}

TEST_F(ModbusDrives, IaiStatusBitsMirrorTheStatusWord) {
  home_linear();
  // 0100 first in the lowest bit; DSS1 3018 from bit 15 down is 0011 0000 0001 1000.
  EXPECT_EQ(client().ask(kIai, "01 01 00 00 10"), "01 02 0C 18");
  EXPECT_EQ(client().ask(kIai, "02 01 03 00 01"), "02 01 01");
  move(1000);
  EXPECT_EQ(client().ask(kIai, "02 01 2A 00 01"), "02 01 01");
  EXPECT_EQ(client().ask(kIai, "01 04 03 00 01"), "01 01 01");
  // The control word of the manual's example: SON is 1000h.
  EXPECT_EQ(client().ask(kIai, "03 0D 00 00 01"), "03 02 10 00");
  client().write(kIai, "06 0D 00 00 00");
  EXPECT_EQ(status() >> 12 & 1, 0);
  EXPECT_FALSE(moving());
}

TEST_F(ModbusDrives, IaiEmergencyStopAndPersistingAlarm) {
  home_linear();
  move(10000);
  clock_.sleep_s(0.3);
  server_.set_emergency_stop(kIai, true);
  EXPECT_EQ(status() & 0xF000, 0xA000);  // emergency stop, ready; servo off
  EXPECT_EQ(alarm(), 0);
  EXPECT_FALSE(moving());
  coil(0x0403, true);
  EXPECT_EQ(status() >> 12 & 1, 0);
  server_.set_emergency_stop(kIai, false);
  EXPECT_EQ(status() >> 12 & 1, 0) << "releasing must not restart";
  coil(0x0403, true);
  EXPECT_EQ(status(), 0x3018) << "target := actual";
  EXPECT_FALSE(moving());

  server_.raise_alarm(kIai, 0x0E8, AlarmCause::kPersists);
  EXPECT_EQ(alarm(), 0x0E8);
  coil(0x0407, true);
  coil(0x0407, false);
  EXPECT_EQ(alarm(), 0x0E8);
  server_.clear_alarm_cause(kIai);
  EXPECT_EQ(alarm(), 0x0E8);
  coil(0x0407, true);
  coil(0x0407, false);
  EXPECT_EQ(alarm(), 0);
}

TEST_F(ModbusDrives, HomeSurvivesServoOff) {
  home_linear();
  coil(0x0403, false);
  EXPECT_EQ(status(), 0x2010);
  home_tilt();
  inputs(1 << 6);
  EXPECT_EQ(outputs(), 1 << 4);
}

TEST_F(ModbusDrives, AzHomesAndMovesToEveryTargetWithinOneStep) {
  EXPECT_FALSE(output(4));
  home_tilt();
  EXPECT_LE(std::abs(steps()), 1);
  std::mt19937 random(2);
  std::uniform_int_distribution<int> anywhere(-5700, 6800);
  for (int i = 0; i < 25; ++i) {
    const int target = anywhere(random);
    client().write(kAz, direct(1, target));
    ASSERT_TRUE(az_standstill());
    EXPECT_LE(std::abs(steps() - target), 1);
    EXPECT_EQ(client().read32(kAz, 0x0122), target);
    EXPECT_EQ(client().read32(kAz, 0x00C6), target);
    EXPECT_EQ(client().read32(kAz, 0x00CC), steps());
    EXPECT_EQ(outputs(), 0x4030);  // ABSPEN, READY, IN-POS
    EXPECT_NEAR(tilt_.observe(clock_.now_s()).true_position, target * kRadPerStep, 1e-4);
  }
}

TEST_F(ModbusDrives, AzGoldenDirectDataFrame) {
  home_tilt();
  // Number 0, type 1, -1000 steps, 2000 Hz, 5 kHz/s twice, 100.0 %, trigger 1.
  client().write(kAz,
                 "10 00 58 00 10 20 00 00 00 00 00 00 00 01 FF FF FC 18 00 00 07 D0 00 00 13 88 00 00 13 88 "
                 "00 00 03 E8 00 00 00 01");
  EXPECT_EQ(outputs(), 0x2010);  // MOVE and ABSPEN; neither READY nor IN-POS
  clock_.sleep_s(0.2);
  EXPECT_EQ(client().read32(kAz, 0x00D0), -1000);  // 5000 Hz/s for 0.2 s
  ASSERT_TRUE(az_standstill());
  EXPECT_EQ(client().ask(kAz, "03 01 20 00 02"), "03 04 FF FF FC 18");
}

TEST_F(ModbusDrives, AzTriggersOnTheItemThatItsTriggerNames) {
  home_tilt();
  client().write(kAz, direct(1, 0, 2000, 0));
  EXPECT_FALSE(output(13));
  client().write(kAz, "10 00 5C 00 02 04 00 00 01 F4");  // position 500: no trigger yet
  EXPECT_FALSE(output(13));
  client().write(kAz, "10 00 66 00 02 04 FF FF FF FB");  // trigger -5
  EXPECT_FALSE(output(13));
  client().write(kAz, "10 00 5E 00 02 04 00 00 03 E8");  // speed
  EXPECT_FALSE(output(13));
  client().write(kAz, "10 00 5C 00 02 04 00 00 01 F4");
  EXPECT_TRUE(output(13));
  ASSERT_TRUE(az_standstill());
  EXPECT_EQ(steps(), 500);
}

TEST_F(ModbusDrives, AzIncrementalMovesAddUp) {
  home_tilt();
  client().write(kAz, direct(2, 700));
  ASSERT_TRUE(az_standstill());
  client().write(kAz, direct(3, -200));
  ASSERT_TRUE(az_standstill());
  EXPECT_EQ(steps(), 500);
}

TEST_F(ModbusDrives, AzIncrementalMoveIsPossibleBeforeHoming) {
  const int before = steps();
  const double true_before = tilt_.observe(clock_.now_s()).true_position;
  const int away = true_before > 0 ? -1000 : 1000;
  client().write(kAz, direct(2, away));
  ASSERT_TRUE(az_standstill());
  EXPECT_LE(std::abs(steps() - before - away), 1);
  EXPECT_EQ(az_alarm(), 0);
}

TEST_F(ModbusDrives, AzAlarms) {
  client().write(kAz, direct(1, 100));
  EXPECT_EQ(az_alarm(), 0x4A);
  EXPECT_EQ(outputs(), 1 << 7);
  client().write(kAz, direct(2, 100));
  EXPECT_FALSE(output(13)) << "an alarm inhibits motion";
  inputs(1 << 7);
  EXPECT_EQ(az_alarm(), 0);
  inputs(0);
  home_tilt();

  client().write(kAz, direct(1, 10000));  // 1.745 rad; the travel ends at 1.2
  EXPECT_EQ(az_alarm(), 0);
  ASSERT_TRUE(az_standstill());
  EXPECT_EQ(az_alarm(), 0x67);
  EXPECT_EQ(steps(), std::lround(1.2 / kRadPerStep));
  inputs(1 << 7);
  EXPECT_EQ(az_alarm(), 0);
  EXPECT_EQ(outputs(), 0x4030) << "energised again, still homed, target := actual";

  inputs(0);
  client().write(kAz, direct(1, -10000));
  ASSERT_TRUE(az_standstill());
  EXPECT_EQ(az_alarm(), 0x67);
  inputs(1 << 7);

  server_.set_emergency_stop(kAz, true);
  EXPECT_EQ(az_alarm(), 0x68);
  inputs(0);
  inputs(1 << 7);
  EXPECT_EQ(az_alarm(), 0x68);
  server_.set_emergency_stop(kAz, false);
  EXPECT_EQ(az_alarm(), 0x68);
  inputs(1 << 7);
  EXPECT_EQ(az_alarm(), 0x68) << "needs an edge";
  inputs(0);
  inputs(1 << 7);
  EXPECT_EQ(az_alarm(), 0);

  client().write(kAz, direct(1, 100, 0));
  EXPECT_EQ(az_alarm(), 0x70);
}

TEST_F(ModbusDrives, AzStopAndFree) {
  home_tilt();
  client().write(kAz, direct(1, 5000));
  clock_.sleep_s(0.5);
  inputs(1 << 5);
  ASSERT_TRUE(az_standstill());
  const int stopped = steps();
  EXPECT_GT(stopped, 0);
  EXPECT_LT(stopped, 4000);
  EXPECT_EQ(outputs(), 0x4010) << "not READY while STOP is on";
  client().write(kAz, direct(1, 0));
  EXPECT_FALSE(output(13));
  inputs(0);
  EXPECT_FALSE(output(13)) << "the stopped travel is forgotten";

  client().write(kAz, direct(1, 0));
  clock_.sleep_s(0.2);
  inputs(1 << 6);
  EXPECT_EQ(outputs(), 1 << 4);
  client().write(kAz, direct(1, 0));
  EXPECT_FALSE(output(13));
  inputs(0);
  EXPECT_EQ(outputs(), 0x4030);
  client().write(kAz, direct(1, 0));
  ASSERT_TRUE(az_standstill());
  EXPECT_EQ(steps(), 0);
}

TEST_F(ModbusDrives, AStopDuringHomingLeavesTheAxisUnhomed) {
  inputs(1 << 4);
  clock_.sleep_s(0.1);
  inputs(1 << 5);
  clock_.sleep_s(60);
  EXPECT_FALSE(output(4));
  coil(0x0403, true);
  coil(0x040B, true);
  clock_.sleep_s(0.1);
  coil(0x042C, true);
  clock_.sleep_s(60);
  EXPECT_EQ(status() >> 4 & 1, 0);
}

TEST_F(ModbusDrives, AzRefusesValuesOutsideTheirRangeAndWritesNothing) {
  home_tilt();
  const auto before = client().read(kAz, 0x0058, 16);
  for (const std::string& pdu :
       {direct(4, 0), direct(8, 0), direct(16, 0), direct(1, 0, 4'000'001), direct(1, 0, 2000, 2),
        direct(1, 0, 2000, -8), std::string("10 00 60 00 02 04 00 00 00 00"),
        std::string("10 00 64 00 02 04 00 00 03 E9"), std::string("06 00 58 00 01")})
    EXPECT_EQ(client().ask(kAz, pdu), (pdu.substr(0, 2) == "10" ? "90 04" : "86 04")) << pdu;
  EXPECT_EQ(client().read(kAz, 0x0058, 16), before);
  EXPECT_FALSE(output(13));
}

TEST_F(ModbusDrives, IllegalRequestsGetTheStandardsExceptions) {
  const struct {
    int unit;
    const char* pdu;
    const char* reply;
  } cases[] = {
      {kIai, "04 90 00 00 01", "84 01"},  // functions that the drives do not have
      {kIai, "0F 04 03 00 01 01 01", "8F 01"},
      {kIai, "2B 0E 01 00", "AB 01"},
      {kIai, "03", "83 03"},  // truncated inside its frame
      {kIai, "03 90 00 00", "83 03"},
      {kIai, "03 90 00 00 01 00", "83 03"},  // too long
      {kIai, "03 90 00 00 00", "83 03"},     // quantities
      {kIai, "03 90 00 00 7E", "83 03"},
      {kIai, "01 01 00 00 00", "81 03"},
      {kIai, "02 01 00 07 D1", "82 03"},
      {kIai, "05 04 03 00 01", "85 03"},              // coil value
      {kIai, "10 99 00 00 02 03 00 00 00", "90 03"},  // byte count
      {kIai, "10 99 00 00 02 04 00 00 00", "90 03"},
      {kIai, "10 99 00 00 02 03 00 00 00 00", "90 03"},
      {kIai, "10 99 00 00 00 00", "90 03"},
      {kIai, "03 90 0C 00 01", "83 02"},  // addresses
      {kIai, "03 90 00 00 0D", "83 02"},
      {kIai, "03 00 00 00 01", "83 02"},
      {kIai, "03 FF FF 00 02", "83 02"},
      {kIai, "01 00 FF 00 01", "81 02"},
      {kIai, "01 01 2F 00 02", "81 02"},
      {kIai, "05 04 02 FF 00", "85 02"},
      {kIai, "05 01 03 FF 00", "85 02"},
      {kIai, "06 90 02 00 00", "86 02"},  // read-only
      {kIai, "06 99 00 00 00", "86 02"},  // half a 32-bit register
      {kIai, "10 99 01 00 02 04 00 00 00 00", "90 02"},
      {kIai, "10 99 00 00 0A 14 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00", "90 02"},
      {kAz, "01 00 00 00 01", "81 01"},
      {kAz, "05 00 7D FF 00", "85 01"},
      {kAz, "03 00 57 00 02", "83 02"},
      {kAz, "03 00 67 00 02", "83 02"},
      {kAz, "06 00 7F 00 00", "86 02"},
      {kAz, "10 00 7C 00 04 08 00 00 00 00 00 00 00 00", "90 02"},
      {3, "03 90 00 00 01", "83 0B"},  // nobody there
      {0, "03 90 00 00 01", "83 0B"},
  };
  for (const auto& c : cases) EXPECT_EQ(client().ask(c.unit, c.pdu), c.reply) << c.pdu;
  EXPECT_EQ(status(), 0x2000);
  EXPECT_EQ(alarm(), 0);
}

TEST_F(ModbusDrives, UnitsAreIndependent) {
  home_linear();
  EXPECT_FALSE(output(4));
  server_.raise_alarm(kAz, 0x30);
  EXPECT_EQ(az_alarm(), 0x30);
  EXPECT_EQ(alarm(), 0);
  EXPECT_THROW(server_.raise_alarm(9, 1), InputError);
}

TEST_F(ModbusDrives, LibmodbusClientAgrees) {
  modbus_t* context = modbus_new_tcp("127.0.0.1", server_.port());
  ASSERT_EQ(modbus_connect(context), 0) << modbus_strerror(errno);
  modbus_set_slave(context, kIai);
  EXPECT_EQ(modbus_write_bit(context, 0x0403, 1), 1);
  uint16_t words[10] = {};
  EXPECT_EQ(modbus_read_registers(context, 0x9000, 10, words), 10);
  EXPECT_EQ(words[5], 0x3008);
  uint8_t bits[16] = {};
  EXPECT_EQ(modbus_read_input_bits(context, 0x0100, 16, bits), 16);
  EXPECT_EQ(bits[3], 1);
  EXPECT_EQ(modbus_read_registers(context, 0x8000, 1, words), -1);
  EXPECT_EQ(errno, EMBXILADD);
  modbus_close(context);
  modbus_free(context);
}

TEST_F(ModbusDrives, HalfAFrameDoesNotDisturbOthersAndIsCompletedLater) {
  Connection slow(server_.port());
  slow.send(bytes("00 01 00 00 00 06 01 03"));
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 20; ++i) EXPECT_EQ(status(), 0x2000);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(2));
  slow.send(bytes("90 02 00 01"));
  EXPECT_EQ(hex(slow.receive_frame()), "00 01 00 00 00 05 01 03 02 00 00");
}

TEST_F(ModbusDrives, PipelinedRequestsAreAnsweredInOrder) {
  Bytes burst;
  for (int i = 0; i < 50; ++i) {
    const Bytes frame = bytes(hex16(i) + " 00 00 00 06 01 03 90 05 00 01");
    burst.insert(burst.end(), frame.begin(), frame.end());
  }
  client().send(burst);
  for (int i = 0; i < 50; ++i)
    EXPECT_EQ(hex(client().receive_frame()), hex16(i) + " 00 00 00 05 01 03 02 20 00");
}

TEST_F(ModbusDrives, BytesThatAreNotModbusCloseTheConnection) {
  for (const char* nonsense : {"00 01 00 01 00 06 01 03 90 00 00 01", "00 01 00 00 00 01 01",
                               "00 01 00 00 FF FF 01 03", "47 45 54 20 2F 20"}) {
    Connection bad(server_.port());
    bad.send(bytes(nonsense));
    EXPECT_TRUE(bad.closed_by_server()) << nonsense;
    EXPECT_EQ(status(), 0x2000);
  }
}

TEST_F(ModbusDrives, SurvivesGarbageAndBrokenConnections) {
  std::mt19937 random(3);
  std::uniform_int_distribution<int> any_byte(0, 255);
  std::uniform_int_distribution<int> any_length(1, 600);
  for (int i = 0; i < 300; ++i) {
    Connection rude(server_.port());
    Bytes garbage(static_cast<size_t>(any_length(random)));
    for (uint8_t& byte : garbage) byte = static_cast<uint8_t>(any_byte(random));
    rude.send(garbage);
  }
  EXPECT_EQ(status(), 0x2000);
}

TEST_F(ModbusDrives, EveryFramedRequestGetsOneReply) {
  std::mt19937 random(4);
  const auto draw = [&](int max) { return std::uniform_int_distribution<int>(0, max)(random); };
  const int starts[] = {0x0058, 0x0066, 0x007C, 0x0100, 0x0400, 0x0D00, 0x9000, 0x9900};
  for (int i = 0; i < 3000; ++i) {
    Bytes pdu{static_cast<uint8_t>(draw(3) ? 1 + draw(16) : draw(255))};
    const int address = starts[draw(7)] + draw(12);
    const Bytes rest = bytes(hex16(address) + " 00 " + hex({static_cast<uint8_t>(draw(9))}));
    pdu.insert(pdu.end(), rest.begin(), rest.end());
    for (int n = draw(24); n > 0; --n) pdu.push_back(static_cast<uint8_t>(draw(255)));
    const Bytes reply = bytes(client().ask(1 + draw(1), hex(pdu)));
    ASSERT_GE(reply.size(), 2u) << hex(pdu);
    ASSERT_EQ(reply[0] & 0x7F, pdu[0] & 0x7F) << hex(pdu);
    clock_.sleep_s(0.05);
  }
}

TEST_F(ModbusDrives, ManyClientsAtOnce) {
  std::vector<std::unique_ptr<Connection>> clients;
  for (int i = 0; i < 20; ++i) clients.push_back(std::make_unique<Connection>(server_.port()));
  for (auto& c : clients) EXPECT_EQ(c->read(kIai, 0x9005, 1)[0], 0x2000);
  clients.erase(clients.begin(), clients.begin() + 10);
  for (auto& c : clients) EXPECT_EQ(c->read(kIai, 0x9005, 1)[0], 0x2000);
}

TEST_F(ModbusDrives, MoreClientsThanItServesWaitForTheirTurn) {
  std::vector<std::unique_ptr<Connection>> clients;
  for (int i = 0; i < 33; ++i) clients.push_back(std::make_unique<Connection>(server_.port()));
  for (int i = 0; i < 32; ++i) EXPECT_EQ(clients[static_cast<size_t>(i)]->read(kIai, 0x9005, 1)[0], 0x2000);
  clients.erase(clients.begin());
  EXPECT_EQ(clients.back()->read(kIai, 0x9005, 1)[0], 0x2000);
}

TEST(ModbusDriveServer, StopsPromptlyWithClientsConnected) {
  VirtualClock clock;
  SimulatedStage stage({0, 100, 10, 100, 10, 0.01, 0, 0.1}, 1);
  auto server = std::make_unique<ModbusDriveServer>("127.0.0.1", 0, clock);
  server->add({"iai_robo_cylinder", 1, 0.01}, stage);
  server->start();
  Connection idle(server->port());
  idle.read(1, 0x9005, 1);
  idle.send(bytes("00 01 00 00 00 06"));
  const auto begin = std::chrono::steady_clock::now();
  server.reset();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(1));
  EXPECT_TRUE(idle.closed_by_server());
}

TEST(ModbusDriveServer, NamesWhatIsWrongWithItsConfiguration) {
  VirtualClock clock;
  SimulatedStage stage({0, 100, 10, 100, 10, 0.01, 0, 0.1}, 1);
  ModbusDriveServer first("127.0.0.1", 0, clock);
  first.start();
  ModbusDriveServer second("127.0.0.1", first.port(), clock);
  try {
    second.start();
    FAIL() << "the port is taken";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("127.0.0.1:" + std::to_string(first.port())), std::string::npos)
        << error.what();
  }
  for (const char* address : {"0.0.0.0", "192.168.1.1", "localhost", ""})
    EXPECT_THROW(ModbusDriveServer(address, 0, clock), InputError) << address;
  EXPECT_THROW(ModbusDriveServer("127.0.0.1", 70000, clock), InputError);
  EXPECT_THROW(first.add({"kuka", 1, 0.01}, stage), InputError);
  EXPECT_THROW(first.add({"iai_robo_cylinder", 0, 0.01}, stage), InputError);
  EXPECT_THROW(first.add({"iai_robo_cylinder", 248, 0.01}, stage), InputError);
  EXPECT_THROW(first.add({"iai_robo_cylinder", 1, 0.02}, stage), InputError);
  EXPECT_THROW(first.add({"oriental_motor_az", 1, 0.0}, stage), InputError);
  first.add({"iai_robo_cylinder", 1, 0.01}, stage);
  EXPECT_THROW(first.add({"oriental_motor_az", 1, 0.01}, stage), InputError);
}

}  // namespace
}  // namespace gantry
