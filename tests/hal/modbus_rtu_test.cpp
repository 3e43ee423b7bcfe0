// Modbus RTU on pseudo-terminals: against the twin's drives with faults on the wire, and against slaves that
// do what the test says.
#include <atomic>
#include <chrono>
#include <random>
#include <thread>

#include "gantry/sim/twin/modbus_drives.h"
#include "hal/scripted_line.h"
#include "modbus/modbus_bus.h"

namespace gantry {
namespace {

constexpr double kTimeout_s = 0.1;

/// The path registers of a CS2RS keep what is written: 6201 to 6206 of two units, each with numbers of its
/// own.
class RtuBus : public testing::Test {
 protected:
  RtuBus() {
    for (int unit : {1, 2}) server_.add({"leadshine_cs2rs", unit, 0.001}, stage_);
    server_.add({"oriental_motor_az", 3, 0.001}, stage_);
    server_.start();
    open(1);
    for (int unit : {1, 2})
      for (uint16_t a = 0x6201; a <= 0x6206; ++a) {
        const auto done = bus_->write_register(unit, a, number(unit, a), 2.0);
        EXPECT_TRUE(done) << done.error().text();
      }
    EXPECT_TRUE(bus_->write_register(3, 0x005D, 1234, 2.0));
  }

  void open(int read_attempts, double late_answer_s = 1.0) {
    bus_.reset();
    SerialLine line;
    line.device = server_.device();
    line.read_attempts = read_attempts;
    line.late_answer_s = late_answer_s;
    bus_ = make_modbus_bus(line);
  }
  static uint16_t number(int unit, uint16_t address) {
    return static_cast<uint16_t>(1000 * unit + (address & 0xFF));
  }
  Result<std::vector<uint16_t>> read(int unit, uint16_t address, double timeout_s = kTimeout_s) {
    return bus_->read_registers(unit, address, 1, timeout_s);
  }
  void expect_right(int unit, uint16_t address) {
    const auto value = read(unit, address);
    ASSERT_TRUE(value) << value.error().text();
    EXPECT_EQ(value->at(0), number(unit, address));
  }
  WireFaults& faults() { return server_.wire_faults(); }

  VirtualClock clock_;
  SimulatedStage stage_{{.travel_max = 100, .max_speed = 100, .max_acceleration = 1000, .homing_speed = 10},
                        1};
  ModbusDriveServer server_{TwinSerialLine{{}, 115200, false}, clock_};
  std::shared_ptr<ModbusBus> bus_;
};

TEST_F(RtuBus, ReadsAndWritesOfSeveralUnits) {
  for (int unit : {1, 2})
    for (uint16_t a = 0x6201; a <= 0x6206; ++a) expect_right(unit, a);
  const auto many = bus_->read_registers(2, 0x6201, 6, kTimeout_s);
  ASSERT_TRUE(many);
  EXPECT_EQ(many->back(), number(2, 0x6206));
  const auto refused = read(1, 0x7000);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
  EXPECT_EQ(refused.error().message,
            "the device refused the read of register 7000h (exception 2, illegal data address)");
}

// A lost answer, then another read of the same shape: whenever the late one comes, it is not taken for it.
TEST_F(RtuBus, ALateAnswerIsNeverTakenForAnotherRead) {
  for (const double late_by_s : {0.02, 0.1, 0.12, 0.15, 0.2, 0.3}) {
    faults().set_delay_s(late_by_s);
    faults().plan(WireFault::kDelayReply, 1);
    const auto lost = read(1, 0x6201);
    if (late_by_s > kTimeout_s) {
      ASSERT_FALSE(lost);
      EXPECT_EQ(lost.error().kind, FaultKind::kTimeout);
    }
    bool right = false;
    for (int i = 0; i < 20 && !right; ++i) {
      const auto next = read(1, 0x6202);
      right = next.has_value();
      if (right) {
        EXPECT_EQ(next->at(0), number(1, 0x6202)) << "late by " << late_by_s;
      }
    }
    EXPECT_TRUE(right) << "the drive answers again";
    expect_right(1, 0x6203);
  }
  EXPECT_GE(bus_->statistics().strays, 1);
}

TEST_F(RtuBus, NeighboursOfALateUnitAreReadAsUsual) {
  faults().set_delay_s(0.25);
  faults().plan(WireFault::kDelayReply, 1);
  EXPECT_FALSE(read(1, 0x6201));
  for (int i = 0; i < 10; ++i) {
    expect_right(2, 0x6204);
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
  }
  expect_right(1, 0x6202);
}

TEST_F(RtuBus, ADuplicateIsThrownAway) {
  faults().plan(WireFault::kDuplicateReply, 1, 3);
  for (uint16_t a = 0x6201; a <= 0x6206; ++a) expect_right(1, a);
  EXPECT_GE(bus_->statistics().strays, 1);
}

TEST_F(RtuBus, DamageIsToldAtOnceAndTheNextReadIsRight) {
  for (const WireFault fault : {WireFault::kCorruptReply, WireFault::kTruncateReply}) {
    for (int i = 0; i < 10; ++i) {
      faults().plan(fault, 1);
      const auto begin = std::chrono::steady_clock::now();
      const auto damaged = read(1, 0x6201, 2.0);
      const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - begin;
      // A wrong bit may make another unit's answer of it: then ours is missed.
      if (!damaged && damaged.error().kind == FaultKind::kProtocol) {
        EXPECT_LT(waited.count(), 1.0);
      }
      EXPECT_FALSE(damaged);
      bool right = false;
      for (int again = 0; again < 20 && !right; ++again) {
        const auto value = read(1, 0x6202);
        right = value.has_value();
        if (right) {
          EXPECT_EQ(value->at(0), number(1, 0x6202));
        }
      }
      EXPECT_TRUE(right);
    }
  }
}

TEST_F(RtuBus, AReadIsRepeatedAndAMotionNever) {
  open(2);
  faults().plan(WireFault::kDropReply, 3);
  const auto value = bus_->read_registers(3, 0x005D, 1, 1.0);
  ASSERT_TRUE(value) << value.error().text();
  EXPECT_EQ(value->at(0), 1234);
  EXPECT_EQ(bus_->statistics().retries, 1);

  faults().plan(WireFault::kDropReply, 3);
  const uint16_t words[] = {0, 77};
  const auto once = bus_->write_registers(3, 0x005C, words, 0.3);
  ASSERT_FALSE(once);
  EXPECT_EQ(once.error().kind, FaultKind::kTimeout);
  EXPECT_EQ(bus_->statistics().retries, 1);

  faults().plan(WireFault::kDropReply, 3);
  EXPECT_TRUE(bus_->write_registers(3, 0x005C, words, 1.0, {.urgent = false, .repeatable = true}));
  EXPECT_EQ(bus_->statistics().retries, 2);
}

TEST_F(RtuBus, ASilentUnitCostsItsNeighboursNoFault) {
  faults().set_silent(1, true);
  for (int i = 0; i < 5; ++i) {
    const auto silent = read(1, 0x6201, 0.03);
    ASSERT_FALSE(silent);
    EXPECT_EQ(silent.error().kind, FaultKind::kTimeout);
    EXPECT_NE(silent.error().message.find("unit 1"), std::string::npos) << silent.error().message;
    expect_right(2, 0x6201);
  }
  faults().clear();
  expect_right(1, 0x6203);
}

TEST_F(RtuBus, ADeadlineHoldsWhateverIsLost) {
  open(3);
  for (const WireFault fault :
       {WireFault::kLoseRequest, WireFault::kDropReply, WireFault::kTruncateReply, WireFault::kDelayReply}) {
    faults().set_probability(fault, 1);
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_FALSE(read(1, 0x6201, 0.2));
    const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - begin;
    EXPECT_LT(waited.count(), 0.2 + 0.15);
    faults().clear();
  }
}

TEST_F(RtuBus, WhateverHappensOnTheWireNoWrongNumberComes) {
  open(2, 0.2);
  faults().reseed(11);
  faults().set_delay_s(0.05);
  for (const WireFault fault :
       {WireFault::kLoseRequest, WireFault::kDropReply, WireFault::kDelayReply, WireFault::kTruncateReply,
        WireFault::kCorruptReply, WireFault::kDuplicateReply, WireFault::kException})
    faults().set_probability(fault, 0.06);
  std::mt19937 random(12);
  int right = 0, failed = 0;
  for (int i = 0; i < 250; ++i) {
    const int unit = 1 + static_cast<int>(random() % 2);
    const auto address = static_cast<uint16_t>(0x6201 + random() % 6);
    const auto value = read(unit, address, 0.06);
    if (!value) {
      ++failed;
      continue;
    }
    ++right;
    ASSERT_EQ(value->at(0), number(unit, address)) << i;
  }
  EXPECT_GT(right, 120);
  EXPECT_GT(failed, 5) << "the faults did come";
  faults().clear();
  for (int i = 0; i < 10; ++i) (void)read(1, 0x6201);
  expect_right(1, 0x6202);
  expect_right(2, 0x6203);
}

TEST_F(RtuBus, ADeviceThatVanishesComesBackWithoutARestart) {
  const auto folder = std::filesystem::temp_directory_path() / ("gantry_line_" + std::to_string(getpid()));
  ModbusDriveServer server({folder, 115200, false}, clock_);
  server.add({"oriental_motor_az", 5, 0.001}, stage_);
  server.start();
  SerialLine line;
  line.device = folder;
  line.read_attempts = 1;
  const auto bus = make_modbus_bus(line);
  ASSERT_TRUE(bus->read_registers(5, 0x007E, 2, 1.0));
  server.set_plugged(false);
  for (int i = 0; i < 2; ++i) {
    const auto gone = bus->read_registers(5, 0x007E, 2, kTimeout_s);
    ASSERT_FALSE(gone);
    EXPECT_EQ(gone.error().kind, FaultKind::kUnreachable) << gone.error().text();
  }
  server.set_plugged(true);
  const auto back = bus->read_registers(5, 0x007E, 2, 1.0);
  ASSERT_TRUE(back) << back.error().text();
  const BusStatistics statistics = bus->statistics();
  EXPECT_EQ(statistics.reconnects, 1);
  EXPECT_EQ(statistics.unreachable, 2);
  EXPECT_NE(statistics.last_error.find(folder.string()), std::string::npos) << statistics.last_error;
}

TEST_F(RtuBus, ALineHasOneOwner) {
  expect_right(1, 0x6201);  // holds it
  SerialLine line;
  line.device = server_.device();
  const auto second = make_modbus_bus(line);
  const auto refused = second->read_registers(1, 0x6201, 1, kTimeout_s);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("another program holds it"), std::string::npos)
      << refused.error().text();
}

TEST_F(RtuBus, TheStatisticsCountWhatHappened) {
  open(1);
  for (int i = 0; i < 5; ++i) expect_right(1, 0x6201);
  (void)read(1, 0x7000);
  faults().plan(WireFault::kDropReply, 2);
  (void)read(2, 0x6201, 0.03);
  const BusStatistics s = bus_->statistics();
  EXPECT_EQ(s.requests, 7);
  EXPECT_EQ(s.exceptions, 1);
  EXPECT_EQ(s.timeouts, 1);
  EXPECT_EQ(s.wrong_answers, 0);
  EXPECT_EQ(s.round_trips, 6);
  EXPECT_GT(s.round_trip_min_us, 0);
  EXPECT_LE(s.round_trip_min_us, s.round_trip_median_us);
  EXPECT_LE(s.round_trip_median_us, s.round_trip_p99_us);
  EXPECT_LE(s.round_trip_p99_us, s.round_trip_max_us);
  EXPECT_NE(s.last_error.find("no complete answer to the read of register 6201h"), std::string::npos);
}

// ---- Slaves that do as the test says ---------------------------------------------------------------

using Bytes = ScriptedLine::Bytes;

/// The answer of a slave whose registers hold their own addresses.
Bytes own_address(const Bytes& request) {
  return rtu_frame(request[0], Bytes{0x03, 2, request[2], request[3]});
}

// A slave that says nothing to function 08: the line stays closed to it for late_answer_s, then opens again.
TEST(RtuScripted, ASlaveWithoutLineCheckIsLeftAloneUntilNoAnswerCanBeLate) {
  std::atomic<int> reads{0}, checks{0};
  ScriptedLine slave([&](const Bytes& request, const auto& say) {
    if (request[1] == 0x08) {
      ++checks;
      return;
    }
    if (++reads == 1) std::this_thread::sleep_for(std::chrono::milliseconds(150));
    say(own_address(request));
  });
  const auto bus = make_modbus_bus(slave.line(0.4));
  ASSERT_FALSE(bus->read_registers(1, 0x1111, 1, 0.05));
  const auto begin = std::chrono::steady_clock::now();
  for (;;) {
    const auto value = bus->read_registers(1, 0x2222, 1, 0.05);
    const std::chrono::duration<double> since = std::chrono::steady_clock::now() - begin;
    ASSERT_LT(since.count(), 3);
    if (!value) continue;
    EXPECT_EQ(value->at(0), 0x2222);
    EXPECT_GT(since.count(), 0.3);
    break;
  }
  EXPECT_GE(checks, 2);
}

TEST(RtuScripted, AnAnswerOfAnotherUnitFunctionOrSizeIsPassedOver) {
  ScriptedLine slave([&](const Bytes& request, const auto& say) {
    say(rtu_frame(9, Bytes{0x03, 2, 0xBA, 0xAD}));
    say(rtu_frame(request[0], Bytes{0x04, 2, 0xBA, 0xAD}));
    say(rtu_frame(request[0], Bytes{0x03, 4, 0xBA, 0xAD, 0xBA, 0xAD}));
    say(own_address(request));
  });
  const auto bus = make_modbus_bus(slave.line());
  const auto value = bus->read_registers(1, 0x1234, 1, 1.0);
  ASSERT_TRUE(value) << value.error().text();
  EXPECT_EQ(value->at(0), 0x1234);
  EXPECT_EQ(bus->statistics().strays, 3);
}

TEST(RtuScripted, BytesMayComeOneByOne) {
  ScriptedLine slave([&](const Bytes& request, const auto& say) {
    for (const uint8_t byte : own_address(request)) {
      say({byte});
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  });
  const auto bus = make_modbus_bus(slave.line());
  const auto value = bus->read_registers(1, 0x1234, 1, 1.0);
  ASSERT_TRUE(value) << value.error().text();
  EXPECT_EQ(value->at(0), 0x1234);
}

TEST(RtuScripted, AFrameWhoseEndDoesNotComeIsGivenUpBeforeTheDeadline) {
  ScriptedLine slave([&](const Bytes& request, const auto& say) {
    Bytes part = own_address(request);
    part.resize(4);
    say(part);
  });
  const auto bus = make_modbus_bus(slave.line());
  const auto begin = std::chrono::steady_clock::now();
  const auto value = bus->read_registers(1, 0x1234, 1, 3.0);
  const std::chrono::duration<double> waited = std::chrono::steady_clock::now() - begin;
  ASSERT_FALSE(value);
  EXPECT_EQ(value.error().kind, FaultKind::kProtocol);
  EXPECT_LT(waited.count(), 1.0);
}

TEST(RtuScripted, ALineThatIsNeverQuietIsTold) {
  std::atomic<bool> stop{false};
  ScriptedLine slave([&](const Bytes&, const auto& say) {
    for (int i = 0; i < 2000 && !stop; ++i) {
      say({0x55});
      std::this_thread::sleep_for(std::chrono::microseconds(300));
    }
  });
  const auto bus = make_modbus_bus(slave.line());
  (void)bus->read_registers(1, 1, 1, 0.05);
  const auto noisy = bus->read_registers(2, 1, 1, 0.05);
  stop = true;
  ASSERT_FALSE(noisy);
}

TEST(RtuScripted, WhatIsNoSerialDeviceIsRefused) {
  SerialLine line;
  line.device = "/dev/null";
  const auto bus = make_modbus_bus(line);
  const auto value = bus->read_registers(1, 1, 1, 0.05);
  ASSERT_FALSE(value);
  EXPECT_NE(value.error().message.find("/dev/null: this is no serial device"), std::string::npos);
  for (const auto break_it :
       {+[](SerialLine& l) { l.baud = 12345; }, +[](SerialLine& l) { l.stop_bits = 0; },
        +[](SerialLine& l) { l.device = ""; }, +[](SerialLine& l) { l.read_attempts = 0; },
        +[](SerialLine& l) { l.late_answer_s = -1; }}) {
    SerialLine bad = line;
    break_it(bad);
    EXPECT_THROW(make_modbus_bus(bad), InputError);
  }
}

}  // namespace
}  // namespace gantry
