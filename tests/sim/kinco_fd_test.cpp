#include "sim/modbus_client.h"

namespace gantry {
namespace {

constexpr int kUnit = 1;
constexpr double kMmPerCount = 5.0 / 65536;

class Kinco : public ::testing::Test {
 protected:
  Kinco() {
    server_.add({"kinco_fd", kUnit, kMmPerCount}, stage_);
    server_.start();
    client_ = std::make_unique<Connection>(server_.port());
  }
  int status() { return client_->read(kUnit, 0x3200, 1)[0]; }
  /// Of the state machine: bits 0 to 3, 5 and 6.
  int state() { return status() & 0x6F; }
  void control(int word) { client_->write(kUnit, "06 31 00 " + hex16(word)); }
  /// Low word first.
  void put32(int address, int64_t value) {
    const auto bits = static_cast<uint32_t>(static_cast<int32_t>(value));
    client_->write(kUnit, "10 " + hex16(address) + " 00 02 04 " + hex16(static_cast<int>(bits & 0xFFFF)) +
                              " " + hex16(static_cast<int>(bits >> 16)));
  }
  int32_t get32(int address) {
    const auto words = client_->read(kUnit, address, 2);
    return static_cast<int32_t>(static_cast<uint32_t>(words[1]) << 16 | static_cast<uint32_t>(words[0]));
  }
  void rest() {
    for (int i = 0; i < 3000 && !(status() & 1 << 10); ++i) clock_.sleep_s(0.02);
    ASSERT_TRUE(status() & 1 << 10);
  }
  void enable() {
    for (const int word : {0x06, 0x07, 0x0F}) control(word);
    ASSERT_EQ(state(), 0x27);
  }
  void home() {
    enable();
    client_->write(kUnit, "06 35 00 00 06");
    control(0x1F);
    rest();
    ASSERT_TRUE(status() & 1 << 15);
    control(0x0F);
    client_->write(kUnit, "06 35 00 00 01");
    put32(0x4A00, 21'474'836);  // 100 mm/s: 20 turns/s = 1200 rpm; 1200 * 512 * 65536 / 1875
    put32(0x4B00, 214'748);     // 1000 mm/s^2 = 200 turns/s^2; 200 * 65536 * 65536 / 4e6
    put32(0x4C00, 214'748);
  }
  void set_point(int64_t counts, int flags = 0x20) {
    put32(0x4000, counts);
    control(0x0F | flags);
    control(0x1F | flags);
  }

  VirtualClock clock_;
  SimulatedStage stage_{{-5, 305, 200, 2000, 50, kMmPerCount, 0.001, 0.15}, 6};
  ModbusDriveServer server_{"127.0.0.1", 0, clock_};
  std::unique_ptr<Connection> client_;
};

TEST_F(Kinco, GoldenFramesOfTheManual) {
  // 12.3, without the serial line's unit and checksum.
  EXPECT_EQ(client_->ask(kUnit, "03 32 00 00 02"), "03 04 04 70 00 00")
      << "switch on disabled, voltage, at rest";
  EXPECT_EQ(client_->ask(kUnit, "06 31 00 00 0F"), "06 31 00 00 0F");
  EXPECT_EQ(client_->ask(kUnit, "10 4A 00 00 02 04 55 55 00 08"), "10 4A 00 00 02");
  EXPECT_EQ(get32(0x4A00), 0x00085555);
}

TEST_F(Kinco, TheStateMachineIsThatOfCia402) {
  const struct {
    int word, state;
  } walk[] = {
      {0x0F, 0x60}, {0x07, 0x60}, {0x06, 0x21}, {0x00, 0x60}, {0x06, 0x21}, {0x07, 0x23},
      {0x06, 0x21}, {0x02, 0x60}, {0x06, 0x21}, {0x07, 0x23}, {0x0F, 0x27}, {0x07, 0x23},
      {0x0F, 0x27}, {0x06, 0x21}, {0x0F, 0x27}, {0x02, 0x07}, {0x0F, 0x27}, {0x02, 0x07},
      {0x00, 0x60}, {0x06, 0x21}, {0x07, 0x23}, {0x0F, 0x27}, {0x00, 0x60},
  };
  client_->write(kUnit, "06 34 00 00 06");
  int step = 0;
  for (const auto& [word, expected] : walk) {
    control(word);
    EXPECT_EQ(state(), expected) << "step " << step << ", control word " << word;
    EXPECT_EQ(stage_.observe(clock_.now_s()).servo_on, expected == 0x27 || expected == 0x07);
    ++step;
  }
}

TEST_F(Kinco, AQuickStopWithoutTheRightOptionEndsWithoutPower) {
  home();
  set_point(2'000'000);
  clock_.sleep_s(0.5);
  control(0x02);
  EXPECT_EQ(state(), 0x07);
  clock_.sleep_s(2);
  EXPECT_EQ(state(), 0x60);
}

TEST_F(Kinco, HomesAndMovesByHandshake) {
  home();
  for (const int64_t target : {1'000'000, 0, 3'900'000, -60'000, 777}) {
    set_point(target);
    EXPECT_EQ(status() & 0x1400, 0x1000) << "taken, not reached";
    EXPECT_NE(get32(0x3B00), 1 << 30);
    control(0x2F);
    EXPECT_EQ(status() & 0x1000, 0);
    rest();
    EXPECT_NEAR(get32(0x3700), static_cast<double>(target), 2);
  }
}

TEST_F(Kinco, UnitsAreThoseOfTheManual) {
  home();
  set_point(3'000'000);
  clock_.sleep_s(0.05);
  EXPECT_NEAR(stage_.observe(clock_.now_s()).velocity, 50, 0.01);
  clock_.sleep_s(0.2);
  EXPECT_NEAR(stage_.observe(clock_.now_s()).velocity, 100, 0.01);
  EXPECT_NEAR(get32(0x3B00), 21'474'836, 25);
}

TEST_F(Kinco, TheHaltBitOnlyDelaysTheOldTarget) {
  home();
  set_point(3'000'000);
  control(0x2F);
  clock_.sleep_s(0.5);
  control(0x12F);
  rest();
  const int32_t halted = get32(0x3700);
  EXPECT_LT(halted, 1'500'000);
  control(0x2F);
  rest();
  EXPECT_NEAR(get32(0x3700), 3'000'000, 2) << "the trap: it runs on";
}

TEST_F(Kinco, AQuickStopForgetsTheTarget) {
  client_->write(kUnit, "06 34 00 00 06");
  home();
  set_point(3'000'000);
  clock_.sleep_s(0.5);
  control(0x02);
  clock_.sleep_s(1);
  const int32_t stopped = get32(0x3700);
  control(0x0F);
  clock_.sleep_s(1);
  EXPECT_EQ(get32(0x3700), stopped);
  EXPECT_TRUE(stage_.observe(clock_.now_s()).servo_on);
}

TEST_F(Kinco, WithoutChangeAtOnceASetPointWaitsForTheEndOfTheMotion) {
  home();
  set_point(1'000'000, 0);
  control(0x0F);
  clock_.sleep_s(0.1);
  set_point(200'000, 0);
  EXPECT_EQ(status() & 0x1000, 0) << "not taken yet";
  rest();
  EXPECT_EQ(status() & 0x1000, 0x1000);
  control(0x0F);
  rest();
  EXPECT_NEAR(get32(0x3700), 200'000, 2);
}

TEST_F(Kinco, AFaultIsResetByARisingEdge) {
  home();
  server_.raise_alarm(kUnit, 0x123);
  EXPECT_EQ(state(), 0x28);
  EXPECT_EQ(client_->read(kUnit, 0x1F00, 1)[0], 0x123);
  EXPECT_FALSE(stage_.observe(clock_.now_s()).servo_on);
  control(0x0F);
  EXPECT_EQ(state(), 0x28);
  control(0x80);
  EXPECT_EQ(state(), 0x60);
  control(0x00);
  server_.raise_alarm(kUnit, 0x9, AlarmCause::kPersists);
  control(0x80);
  EXPECT_EQ(state(), 0x28);
  server_.clear_alarm_cause(kUnit);
  EXPECT_EQ(state(), 0x28) << "the bit is still on: no edge";
  control(0x00);
  control(0x80);
  EXPECT_EQ(state(), 0x60);
  EXPECT_TRUE(status() & 1 << 15) << "still homed";
}

TEST_F(Kinco, TheHardwareLockTakesThePower) {
  home();
  set_point(3'000'000);
  clock_.sleep_s(0.3);
  server_.set_emergency_stop(kUnit, true);
  EXPECT_EQ(get32(0x6D00), 1 << 3);
  EXPECT_EQ(state(), 0x60);
  control(0x06);
  EXPECT_EQ(state(), 0x60);
  server_.set_emergency_stop(kUnit, false);
  EXPECT_EQ(state(), 0x60);
  enable();
  const int32_t here = get32(0x3700);
  clock_.sleep_s(2);
  EXPECT_EQ(get32(0x3700), here) << "no jump";
}

TEST_F(Kinco, Exceptions) {
  EXPECT_EQ(client_->ask(kUnit, "03 32 01 00 01"), "83 02");
  EXPECT_EQ(client_->ask(kUnit, "03 32 00 00 03"), "83 02");
  EXPECT_EQ(client_->ask(kUnit, "06 32 00 00 01"), "86 02");
  EXPECT_EQ(client_->ask(kUnit, "06 40 00 00 01"), "86 02") << "half of a 32-bit object";
  EXPECT_EQ(client_->ask(kUnit, "06 35 00 00 03"), "86 03") << "a mode that the twin does not have";
  EXPECT_EQ(client_->ask(kUnit, "01 32 00 00 01"), "81 01");
}

}  // namespace
}  // namespace gantry
