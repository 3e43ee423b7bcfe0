#include "sim/modbus_client.h"

namespace gantry {
namespace {

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

}  // namespace
}  // namespace gantry
