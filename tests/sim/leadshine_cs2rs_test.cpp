#include "sim/modbus_client.h"

namespace gantry {
namespace {

constexpr int kUnit = 7;
constexpr double kMmPerPulse = 0.0005;  // 5 mm a turn.

class Cs2rs : public ::testing::Test {
 protected:
  Cs2rs() {
    server_.add({"leadshine_cs2rs", kUnit, kMmPerPulse}, stage_);
    server_.start();
    client_ = std::make_unique<Connection>(server_.port());
  }
  int word(int address) { return client_->read(kUnit, address, 1)[0]; }
  int status() { return word(0x1003); }
  int32_t pulses() { return client_->read32(kUnit, 0x602C); }
  void put(int address, int value) { client_->write(kUnit, "06 " + hex16(address) + " " + hex16(value)); }
  /// Path 0, absolute, with its trigger.
  void path(int64_t target, int rpm, int ramp_ms = 100, int mode = 1) {
    client_->write(kUnit, "10 62 00 00 08 10 " + hex16(mode) + " " + hex32(target) + " " + hex16(rpm) + " " +
                              hex16(ramp_ms) + " " + hex16(ramp_ms) + " 00 00 00 10");
  }
  void rest() {
    for (int i = 0; i < 3000 && status() & 4; ++i) clock_.sleep_s(0.02);
    ASSERT_FALSE(status() & 4);
  }
  void home() {
    put(0x000F, 1);
    put(0x6002, 0x20);
    rest();
    ASSERT_EQ(status(), 0x72);
  }

  VirtualClock clock_;
  SimulatedStage stage_{{-5, 305, 200, 2000, 50, 0.0005, 0.001, 0.15}, 5};
  ModbusDriveServer server_{"127.0.0.1", 0, clock_};
  std::unique_ptr<Connection> client_;
};

TEST_F(Cs2rs, GoldenFrameOfTheManual) {
  // 5.5.4, without the serial line's unit and checksum: path 0 to 10000 at velocity 0, and the answer.
  EXPECT_EQ(client_->ask(kUnit, "10 62 00 00 08 10 00 01 00 00 27 10 00 00 27 10 27 10 00 00 00 10"),
            "10 62 00 00 08");
  EXPECT_EQ(client_->ask(kUnit, "03 62 00 00 08"), "03 10 00 01 00 00 27 10 00 00 27 10 27 10 00 00 00 10");
  EXPECT_EQ(status() & 4, 0) << "no velocity, no motion";
}

TEST_F(Cs2rs, HomesAndMovesWhereItIsTold) {
  EXPECT_EQ(status(), 0x10) << "power-on: no fault, not enabled, nothing to do, not homed";
  home();
  for (const int target : {20000, 0, 600'000, -8000, 123'457}) {
    path(target, 1200);
    EXPECT_EQ(status() & 0x34, 4) << "running, neither command nor path done";
    rest();
    EXPECT_NEAR(pulses(), target, 1);
    EXPECT_EQ(status(), 0x72);
    EXPECT_NEAR(stage_.observe(clock_.now_s()).true_position, target * kMmPerPulse, 0.01);
  }
}

TEST_F(Cs2rs, SpeedIsRpmAndTheRampMillisecondsPer1000Rpm) {
  home();
  path(400'000, 1200, 200);  // 1200 rpm are 100 mm/s, after 240 ms
  clock_.sleep_s(0.12);
  EXPECT_NEAR(stage_.observe(clock_.now_s()).velocity, 50, 0.01);
  clock_.sleep_s(0.2);
  EXPECT_NEAR(stage_.observe(clock_.now_s()).velocity, 100, 0.01);
  rest();
}

TEST_F(Cs2rs, RelativePathsAddUp) {
  home();
  path(1000, 600, 100, 0x41);
  rest();
  path(-3000, 600, 100, 0x41);
  rest();
  EXPECT_NEAR(pulses(), -2000, 1);
}

TEST_F(Cs2rs, NothingRunsWithoutPower) {
  path(10000, 600);
  put(0x6002, 0x20);
  EXPECT_EQ(status(), 0x10);
  home();
  put(0x000F, 0);
  EXPECT_EQ(status() & 0x57, 0x50) << "not enabled, still homed";
  path(10000, 600);
  EXPECT_EQ(status() & 4, 0);
}

TEST_F(Cs2rs, AStopForgetsTheRestOfThePath) {
  home();
  path(400'000, 1200);
  clock_.sleep_s(0.5);
  put(0x6002, 0x40);
  rest();
  EXPECT_EQ(status() & 0x20, 0) << "the path is not done";
  const int32_t stopped = pulses();
  EXPECT_GT(stopped, 0);
  EXPECT_LT(stopped, 300'000);
  clock_.sleep_s(5);
  EXPECT_EQ(pulses(), stopped);
}

TEST_F(Cs2rs, ForcedEnableOutlivesAnAlarm) {
  home();
  server_.raise_alarm(kUnit, 0x20);
  EXPECT_EQ(word(0x2203), 0x20);
  EXPECT_EQ(status() & 3, 1);
  put(0x1801, 0x1111);
  EXPECT_EQ(status() & 3, 2) << "powered again by the reset alone";
  server_.raise_alarm(kUnit, 0x20, AlarmCause::kPersists);
  put(0x000F, 0);
  put(0x1801, 0x1111);
  EXPECT_EQ(status() & 3, 1);
  server_.clear_alarm_cause(kUnit);
  put(0x1801, 0x1111);
  EXPECT_EQ(status() & 3, 0);
}

TEST_F(Cs2rs, TheQuickStopInputTakesPowerAndEnableAway) {
  home();
  path(400'000, 1200);
  clock_.sleep_s(0.5);
  server_.set_emergency_stop(kUnit, true);
  EXPECT_EQ(word(0x602E), 1 << 3);
  EXPECT_EQ(status() & 2, 0);
  put(0x000F, 1);
  EXPECT_EQ(status() & 2, 0);
  server_.set_emergency_stop(kUnit, false);
  EXPECT_EQ(status() & 2, 0) << "not by itself";
  put(0x000F, 1);
  EXPECT_EQ(status() & 2, 2);
}

TEST_F(Cs2rs, BeyondTheTravelTheMotorFallsBehind) {
  home();
  path(700'000, 1200);
  for (int i = 0; i < 500 && !(status() & 1); ++i) clock_.sleep_s(0.05);
  EXPECT_EQ(word(0x2203), 0x20);
  EXPECT_EQ(word(0x602E) & 0x30, 0x20) << "the upper limit";
}

TEST_F(Cs2rs, ExceptionsOfTheManual) {
  EXPECT_EQ(client_->ask(kUnit, "01 00 01 00 01"), "81 01");
  EXPECT_EQ(client_->ask(kUnit, "08 00 00 12 34"), "88 01");
  EXPECT_EQ(client_->ask(kUnit, "03 70 00 00 01"), "83 02");
  EXPECT_EQ(client_->ask(kUnit, "06 10 03 00 01"), "86 02");
  EXPECT_EQ(client_->ask(kUnit, "06 60 02 00 99"), "86 03");
  EXPECT_EQ(client_->ask(kUnit, "06 00 0F 00 02"), "86 03");
}

}  // namespace
}  // namespace gantry
