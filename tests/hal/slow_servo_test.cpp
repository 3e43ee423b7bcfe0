// The kinds pr_path and cia402 on registers that only the test changes: what they write, and what they make
// of what a drive shows.
#include "hal/modbus_servers.h"

namespace gantry {
namespace {

using Words = std::vector<uint16_t>;

class SlowCs2rs : public SlowDrive {
 protected:
  static constexpr uint16_t kFault = 1, kEnabled = 2, kRunning = 4, kPathDone = 0x20, kHomed = 0x40;
  SlowCs2rs() {
    config.axis = "linear";
    config.profile = "leadshine_cs2rs";
    config.host = "127.0.0.1";
    config.port = server.port();
    config.counts_per_axis_unit = 2000;  // One turn of 10000 pulses is 5 mm.
    config.in_position = 0.01;
    drive = make_modbus_drive(config, nullptr, clock);
    server.set(0x0001, 10000);
    server.set(0x1003, kEnabled | kPathDone | kHomed);
  }
  void at(int32_t pulses) {
    server.set(0x602C, static_cast<uint16_t>(static_cast<uint32_t>(pulses) >> 16));
    server.set(0x602D, static_cast<uint16_t>(pulses));
  }
  ModbusDriveConfig config;
};

TEST_F(SlowCs2rs, AMoveIsOnePathWithItsTrigger) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  Words path;
  for (uint16_t a = 0x6200; a <= 0x6207; ++a) path.push_back(server.get(a));
  // 100000 pulses, 1200 rpm, 1000 rpm in 84 ms (83.3 rounded up), no delay, run.
  EXPECT_EQ(path, (Words{1, 0x0001, 0x86A0, 1200, 84, 84, 0, 0x10}));
  ASSERT_TRUE(drive->start_move({-0.5, 0.001, 1000}));
  EXPECT_EQ(server.get(0x6201), 0xFFFF);
  EXPECT_EQ(server.get(0x6202), 0x10000 - 1000);
  EXPECT_EQ(server.get(0x6203), 1) << "the slowest there is";
}

TEST_F(SlowCs2rs, AMoveIsNotInPositionBeforeItShows) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  EXPECT_TRUE(read().moving);
  EXPECT_FALSE(read().in_position);
  server.set(0x1003, kEnabled | kRunning | kHomed);
  at(99'999);
  EXPECT_TRUE(read().moving);
  EXPECT_FALSE(read().in_position);
  server.set(0x1003, kEnabled | kPathDone | kHomed);
  EXPECT_TRUE(read().in_position);
  EXPECT_FALSE(read().moving);
  EXPECT_EQ(read().position, 49.9995);
  at(99'000);
  EXPECT_FALSE(read().in_position) << "half a millimetre away";
}

TEST_F(SlowCs2rs, ACommandThatIsIgnoredNeverCountsAsArrived) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  clock.sleep_s(10);
  EXPECT_FALSE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowCs2rs, HomingAgainIsNotOverBeforeItShows) {
  ASSERT_TRUE(drive->start_homing());
  EXPECT_EQ(server.written(0x6002), Words{0x20});
  EXPECT_TRUE(read().moving);
  server.set(0x1003, kEnabled | kRunning);
  EXPECT_FALSE(read().homed);
  server.set(0x1003, kEnabled | kPathDone | kHomed);
  EXPECT_TRUE(read().homed);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowCs2rs, NothingIsStartedWithoutPowerOrWithAnAlarm) {
  for (const uint16_t status : {kHomed, uint16_t{kEnabled | kFault | kHomed}}) {
    server.set(0x1003, status);
    for (const auto& refused : {drive->start_move({1, 10, 100}), drive->start_homing()}) {
      ASSERT_FALSE(refused);
      EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
    }
  }
  EXPECT_TRUE(server.written(0x6207).empty());
  EXPECT_TRUE(server.written(0x6002).empty());
}

TEST_F(SlowCs2rs, HaltPowerAndReset) {
  ASSERT_TRUE(drive->set_servo(true));
  ASSERT_TRUE(drive->halt());
  EXPECT_EQ(server.written(0x6002), Words{0x40});
  server.set(0x1003, kFault);
  server.set(0x2203, 0x20);
  EXPECT_EQ(read().alarm, 0x20);
  EXPECT_FALSE(read().servo_on);
  ASSERT_TRUE(drive->reset_alarm());
  EXPECT_EQ(server.written(0x000F), (Words{1, 0}))
      << "the forced enable would power the motor after the reset";
  EXPECT_EQ(server.written(0x1801), Words{0x1111});
}

TEST_F(SlowCs2rs, InputsAndFollowingError) {
  EXPECT_FALSE(read().emergency_stop || read().lower_limit || read().upper_limit);
  server.set(0x602E, 1 << 3);
  EXPECT_TRUE(read().emergency_stop);
  server.set(0x602E, 1 << 4);
  EXPECT_TRUE(read().lower_limit);
  server.set(0x602E, 1 << 5);
  EXPECT_TRUE(read().upper_limit);
  at(1000);
  server.set(0x602B, 1400);
  EXPECT_EQ(read().following_error, 0.2);
}

TEST_F(SlowCs2rs, ADriveWithAnotherResolutionIsRefused) {
  EXPECT_TRUE(drive->connect());
  server.set(0x0001, 4000);
  const auto refused = drive->connect();
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("4000 pulses per motor revolution, but 10000"), std::string::npos)
      << refused.error().text();
  config.counts_per_motor_revolution = 4000;
  EXPECT_TRUE(make_modbus_drive(config, nullptr, clock)->connect());
}

class SlowCia402 : public SlowDrive {
 protected:
  static constexpr uint16_t kReached = 1 << 10, kTaken = 1 << 12, kHomed = 1 << 15;
  SlowCia402() {
    ModbusDriveConfig config;
    config.axis = "tilt";
    config.kind = AxisKind::kRotary;
    config.profile = "kinco_fd";
    config.host = "127.0.0.1";
    config.port = server.port();
    config.counts_per_axis_unit = 1000;
    config.in_position = 0.01;
    drive = make_modbus_drive(config, nullptr, clock);
    status(0x60);
    // The states follow the control word; set-points are acknowledged.
    server.on_write([this](auto& registers, uint16_t address, uint16_t value) {
      if (address != 0x3100 || !obedient) return;
      const uint16_t flags = kReached | kHomed;
      uint16_t& word = registers[0x3200];
      if (value == 0x06) word = flags | 0x21;
      if (value == 0x07) word = flags | 0x23;
      if ((value & 0x0F) == 0x0F)
        word = static_cast<uint16_t>(flags | 0x27 | (value & 0x10 && takes ? kTaken : 0));
      if (value == 0x02) word = flags | 0x07;
      if (value == 0x00) word = flags | 0x60;
    });
  }
  void status(uint16_t word) { server.set(0x3200, word | kReached | kHomed); }
  std::atomic<bool> obedient{true}, takes{true};
};

TEST_F(SlowCia402, PowerWalksThroughTheStatesWithTheTargetWhereTheMotorStands) {
  server.set(0x3700, 0x1234);  // low word first
  server.set(0x3701, 0xFFFF);
  ASSERT_TRUE(drive->set_servo(true));
  EXPECT_EQ(server.written(0x3100), (Words{0x06, 0x07, 0x0F}));
  EXPECT_EQ(server.written(0x3500), Words{1});
  EXPECT_EQ(server.written(0x3400), Words{6}) << "quick stop stays under power";
  EXPECT_EQ(server.get(0x4000), 0x1234);
  EXPECT_EQ(server.get(0x4001), 0xFFFF);
  EXPECT_TRUE(read().servo_on);
  ASSERT_TRUE(drive->set_servo(false));
  EXPECT_EQ(server.written(0x3100).back(), 0x00) << "voltage off at once, without a ramp";
  EXPECT_FALSE(read().servo_on);
}

TEST_F(SlowCia402, PowerThatDoesNotComeIsRefusedWithTheState) {
  obedient = false;
  const auto refused = drive->set_servo(true);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("\"switch on disabled\", status word 8460h"), std::string::npos)
      << refused.error().text();
  EXPECT_EQ(server.written(0x3100), Words{0x06}) << "and no step further";
  status(0x08);
  EXPECT_FALSE(drive->set_servo(true)) << "a fault must be reset first";
}

TEST_F(SlowCia402, AMoveIsASetPointHandshake) {
  status(0x27);
  ASSERT_TRUE(drive->start_move({-1.5, 0.5, 2}));
  EXPECT_EQ(server.written(0x3100), (Words{0x2F, 0x3F, 0x2F}));
  EXPECT_EQ(server.get(0x4000), 0x10000 - 1500);
  EXPECT_EQ(server.get(0x4001), 0xFFFF);
  EXPECT_EQ(server.get(0x4A00), 8192);  // 500 counts/s * 16.384
  EXPECT_EQ(server.get(0x4B00), 33);    // 2000 counts/s^2 * 0.016384 = 32.8
  EXPECT_EQ(server.get(0x4C00), 33);
  EXPECT_TRUE(read().moving) << "target reached still speaks of the standstill before";
  EXPECT_FALSE(read().in_position);
  server.set(0x3200, 0x27 | kHomed);
  EXPECT_TRUE(read().moving);
  server.set(0x3700, 0x10000 - 1495);
  server.set(0x3701, 0xFFFF);
  EXPECT_FALSE(read().in_position) << "not reached yet";
  status(0x27);
  EXPECT_TRUE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowCia402, ASetPointThatIsNotTakenIsTakenBack) {
  status(0x27);
  takes = false;
  const auto refused = drive->start_move({1, 0.5, 2});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
  EXPECT_EQ(server.written(0x3100), (Words{0x2F, 0x3F, 0x2F}));
  EXPECT_FALSE(read().in_position);
}

TEST_F(SlowCia402, AHaltIsAQuickStopUnderPowerAndTheNextStartEndsIt) {
  status(0x27);
  ASSERT_TRUE(drive->halt());
  EXPECT_EQ(server.written(0x3100), Words{0x02});
  EXPECT_TRUE(read().servo_on);
  EXPECT_TRUE(read().moving) << "a velocity of zero is not believed so soon";
  clock.sleep_s(0.05);
  EXPECT_FALSE(read().moving);
  server.set(0x3B00, 9000);
  EXPECT_TRUE(read().moving);
  server.set(0x3B00, 0);
  ASSERT_TRUE(drive->start_homing());
  EXPECT_EQ(server.written(0x3100), (Words{0x02, 0x0F, 0x0F, 0x1F}));
  EXPECT_EQ(server.written(0x3500), Words{6});
}

TEST_F(SlowCia402, AFaultIsResetByAnEdgeThatAsksForNoPower) {
  status(0x08);
  server.set(0x1F00, 0x123);
  EXPECT_EQ(read().alarm, 0x123);
  EXPECT_FALSE(read().servo_on);
  EXPECT_FALSE(drive->start_move({1, 1, 1}));
  ASSERT_TRUE(drive->reset_alarm());
  EXPECT_EQ(server.written(0x3100), (Words{0x00, 0x80, 0x00}));
}

TEST_F(SlowCia402, InputsAreThoseOfTheProfile) {
  status(0x27);
  EXPECT_FALSE(read().emergency_stop);
  server.set(0x6D00, 1 << 3);
  EXPECT_TRUE(read().emergency_stop);
  server.set(0x6D00, 1);
  EXPECT_TRUE(read().lower_limit);
  server.set(0x6D00, 2);
  EXPECT_TRUE(read().upper_limit);
}

}  // namespace
}  // namespace gantry
