#include "sim/modbus_client.h"

namespace gantry {
namespace {

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

}  // namespace
}  // namespace gantry
