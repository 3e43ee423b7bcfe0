// Drives that take their time to react, and drives that ignore a command: registers that only the test
// changes.
#include "hal/modbus_servers.h"

namespace gantry {
namespace {

class SlowIai : public SlowDrive {
 protected:
  static constexpr uint16_t kOn = 0x1000, kHomed = 0x0010, kPend = 0x0008, kMoving = 0x0020;
  SlowIai() {
    drive = iai_at(server.port(), clock);
    server.set(0x9005, kOn | kHomed | kPend);
  }
};

TEST_F(SlowIai, AMoveIsNotInPositionBeforeItShows) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(read().in_position);
    EXPECT_TRUE(read().moving);
  }
  server.set(0x9005, kOn | kHomed);
  server.set(0x9007, kMoving);
  EXPECT_TRUE(read().moving);
  server.set(0x9001, 4'995);
  server.set(0x9005, kOn | kHomed | kPend);  // The band is reached, the motion goes on.
  EXPECT_FALSE(read().in_position);
  server.set(0x9007, 0);
  EXPECT_TRUE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowIai, AMoveWithinTheBandEndsEvenIfNoMotionWasSeen) {
  ASSERT_TRUE(drive->start_move({0.05, 100, 1000}));
  EXPECT_FALSE(read().in_position);
  clock.sleep_s(0.3);
  EXPECT_TRUE(read().in_position);
  ASSERT_TRUE(drive->start_move({0.0, 100, 1000}));  // Where it stands.
  EXPECT_TRUE(read().in_position);
}

TEST_F(SlowIai, ACommandThatIsIgnoredNeverCountsAsArrived) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  clock.sleep_s(10);
  EXPECT_FALSE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowIai, HomingAgainIsNotOverBeforeItShows) {
  for (const uint16_t pend : {kPend, uint16_t{0}}) {
    server.set(0x9005, kOn | kHomed | pend);
    ASSERT_TRUE(drive->start_homing());
    EXPECT_TRUE(read().moving);
    server.set(0x9005, kOn);
    EXPECT_FALSE(read().homed);
    server.set(0x9005, kOn | kHomed | kPend);
    EXPECT_TRUE(read().homed);
    EXPECT_FALSE(read().moving);
  }
}

TEST_F(SlowIai, AHaltedMoveIsNotInPositionEvenAtItsTarget) {
  ASSERT_TRUE(drive->start_move({50, 100, 1000}));
  ASSERT_TRUE(drive->halt());
  server.set(0x9001, 5'000);
  clock.sleep_s(1);
  EXPECT_FALSE(read().in_position);
}

TEST_F(SlowIai, APausedDriveIsNotGivenACommandToRunLater) {
  server.set(0x9005, kOn | kHomed | 0x0020);
  const auto moved = drive->start_move({50, 100, 1000});
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().kind, FaultKind::kRefused);
  EXPECT_EQ(server.get(0x9901), 0);
  const auto homed = drive->start_homing();
  ASSERT_FALSE(homed);
  EXPECT_EQ(homed.error().kind, FaultKind::kRefused);
}

class SlowAz : public SlowDrive {
 protected:
  static constexpr uint16_t kHomed = 0x0010, kReady = 0x0020, kAlarm = 0x0080, kMove = 0x2000,
                            kInPos = 0x4000;
  static constexpr uint16_t kStop = 0x0020, kFree = 0x0040, kAlarmReset = 0x0080;
  SlowAz() {
    ModbusDriveConfig config;
    config.axis = "tilt";
    config.kind = AxisKind::kRotary;
    config.profile = "oriental_motor_az";
    config.host = "127.0.0.1";
    config.port = server.port();
    config.counts_per_axis_unit = 1000;
    drive = make_modbus_drive(config, nullptr, clock);
    server.set(0x007F, kHomed | kReady | kInPos);
  }
};

TEST_F(SlowAz, AMoveIsNotInPositionBeforeItShows) {
  ASSERT_TRUE(drive->start_move({-1.5, 0.5, 2}));
  EXPECT_EQ(server.get(0x005B), 1);  // Absolute.
  EXPECT_EQ(server.get(0x005C), 0xFFFF);
  EXPECT_EQ(server.get(0x005D), 0x10000 - 1500);
  EXPECT_EQ(server.get(0x005F), 500);   // Hz
  EXPECT_EQ(server.get(0x0061), 2000);  // 0.001 kHz/s
  EXPECT_EQ(server.get(0x0063), 2000);
  EXPECT_EQ(server.get(0x0067), 1);
  EXPECT_FALSE(read().in_position);
  EXPECT_TRUE(read().moving);
  server.set(0x007F, kHomed | kMove);
  server.set(0x0122, 0xFFFF);
  server.set(0x0123, 0x10000 - 1500);  // The command arrives before the motor.
  EXPECT_FALSE(read().in_position);
  server.set(0x0120, 0xFFFF);
  server.set(0x0121, 0x10000 - 1499);
  server.set(0x007F, kHomed | kReady | kInPos);
  const auto status = read();
  EXPECT_TRUE(status.in_position);
  EXPECT_FALSE(status.moving);
  EXPECT_EQ(status.position, -1.499);
}

TEST_F(SlowAz, ACommandThatIsIgnoredNeverCountsAsArrived) {
  ASSERT_TRUE(drive->start_move({1.5, 0.5, 2}));
  clock.sleep_s(10);
  EXPECT_FALSE(read().in_position);
  EXPECT_FALSE(read().moving);
}

TEST_F(SlowAz, HomingAgainIsNotOverBeforeItShows) {
  ASSERT_TRUE(drive->start_homing());
  EXPECT_TRUE(read().moving);
  server.set(0x007F, kMove);
  EXPECT_TRUE(read().moving);
  server.set(0x007F, kHomed | kReady | kInPos);
  EXPECT_FALSE(read().moving);
  EXPECT_TRUE(read().homed);
}

TEST_F(SlowAz, NothingIsStartedWhileTheDriveIsNotReady) {
  server.set(0x007F, kHomed | kInPos);
  const auto moved = drive->start_move({1.5, 0.5, 2});
  ASSERT_FALSE(moved);
  EXPECT_EQ(moved.error().kind, FaultKind::kRefused);
  EXPECT_NE(moved.error().message.find("not ready"), std::string::npos);
  EXPECT_EQ(server.get(0x0067), 0);
  EXPECT_FALSE(drive->start_homing());
  EXPECT_EQ(server.get(0x007D), 0);
}

TEST_F(SlowAz, StopStaysOnUntilTheNextStartAndNeverPowersTheMotor) {
  ASSERT_TRUE(drive->halt());
  EXPECT_EQ(server.get(0x007D), kStop);
  ASSERT_TRUE(drive->start_move({1.5, 0.5, 2}));
  EXPECT_EQ(server.get(0x007D), 0);
  ASSERT_TRUE(drive->set_servo(false));
  ASSERT_TRUE(drive->halt());
  EXPECT_EQ(server.get(0x007D), kFree | kStop);
}

TEST_F(SlowAz, AlarmAndEmergencyStopAreToldApart) {
  server.set(0x007F, kHomed | kAlarm);
  server.set(0x0081, 0x30);
  EXPECT_EQ(read().alarm, 0x30);
  EXPECT_FALSE(read().emergency_stop);
  EXPECT_FALSE(read().servo_on);
  server.set(0x0081, 0x68);
  EXPECT_TRUE(read().emergency_stop);
  ASSERT_TRUE(drive->reset_alarm());
  EXPECT_EQ(server.written(0x007D), (std::vector<uint16_t>{kFree, kFree | kAlarmReset, kFree}))
      << "a rising edge, and never without FREE: a reset must not power the motor";
}

}  // namespace
}  // namespace gantry
