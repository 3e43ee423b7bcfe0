// One drive of every kind on one RS-485 line, driven end to end while the wire misbehaves a little.
#include <numbers>

#include "gantry/hal/axis.h"
#include "gantry/hal/modbus_drives.h"
#include "gantry/sim/twin/modbus_drives.h"
#include "hal/axis_conformance.h"

namespace gantry {
namespace {

using enum AxisState;

class FourKinds : public testing::Test {
 protected:
  FourKinds() {
    const struct {
      const char* profile;
      double counts;
    } drives[] = {{"iai_robo_cylinder", 0},
                  {"oriental_motor_az", 500},
                  {"leadshine_cs2rs", 2000},
                  {"kinco_fd", 13107.2}};
    for (const auto& [profile, counts] : drives) {
      stages_.push_back(std::make_unique<SimulatedStage>(kStage, stages_.size() + 1));
      const int unit = static_cast<int>(stages_.size());
      server_.add({profile, unit, counts > 0 ? 1 / counts : 0.01}, *stages_.back());
    }
    server_.start();
    SerialLine line;
    line.device = server_.device();
    line.read_attempts = 3;
    bus_ = make_modbus_bus(line);
    for (const auto& [profile, counts] : drives) {
      ModbusDriveConfig config;
      config.axis = profile;
      config.profile = profile;
      config.unit = static_cast<int>(axes_.size()) + 1;
      config.counts_per_axis_unit = counts;
      config.response_timeout_s = 1.0;
      axes_.push_back(std::make_unique<Axis>(make_modbus_drive(config, bus_, clock_), AxisKind::kLinear,
                                             kLimits, clock_));
    }
  }

  /// Updates all until none is in `state`.
  void finish(AxisState state) {
    for (int i = 0; i < 4000; ++i) {
      bool busy = false;
      for (const auto& axis : axes_) {
        const auto status = axis->update();
        ASSERT_TRUE(status) << status.error().text();
        busy |= status->state == state;
      }
      if (!busy) return;
      clock_.sleep_s(0.05);
    }
    FAIL() << "still in " << to_string(state);
  }

  static constexpr StageDynamics kStage{.travel_min = -5,
                                        .travel_max = 305,
                                        .max_speed = 200,
                                        .max_acceleration = 2000,
                                        .homing_speed = 50,
                                        .encoder_resolution = 0.001};
  static constexpr AxisLimits kLimits{
      .lower = 0, .upper = 300, .speed = 100, .acceleration = 1000, .in_position = 0.06};
  VirtualClock clock_;
  std::vector<std::unique_ptr<SimulatedStage>> stages_;
  ModbusDriveServer server_{TwinSerialLine{{}, 115200, false}, clock_};
  std::shared_ptr<ModbusBus> bus_;
  std::vector<std::unique_ptr<Axis>> axes_;
};

TEST_F(FourKinds, HomeMoveHaltAlarmReset) {
  for (const auto& axis : axes_) {
    ASSERT_TRUE(axis->connect());
    const auto enabled = axis->enable();
    ASSERT_TRUE(enabled) << enabled.error().text();
    ASSERT_TRUE(axis->home());
  }
  finish(kHoming);
  for (const auto& axis : axes_) {
    ASSERT_EQ(axis->status().state, kStandstill);
    ASSERT_TRUE(axis->status().drive.homed);
    const auto moving = axis->move_to(200);
    ASSERT_TRUE(moving) << moving.error().text();
  }
  finish(kDiscreteMotion);
  for (const auto& axis : axes_) EXPECT_NEAR(axis->status().drive.position, 200, 0.06) << axis->name();
  for (const auto& stage : stages_) EXPECT_NEAR(stage->observe(clock_.now_s()).true_position, 200, 0.06);

  for (const auto& axis : axes_) ASSERT_TRUE(axis->move_to(20));
  clock_.sleep_s(0.6);
  for (const auto& axis : axes_) ASSERT_TRUE(axis->stop());
  finish(kStopping);
  for (const auto& axis : axes_) {
    EXPECT_GT(axis->status().drive.position, 100) << axis->name();
    EXPECT_LT(axis->status().drive.position, 199) << axis->name();
    ASSERT_TRUE(axis->move_to(250));
  }
  clock_.sleep_s(0.3);
  for (int unit = 1; unit <= 4; ++unit) server_.raise_alarm(unit, 0x21);
  for (const auto& axis : axes_) {
    EXPECT_FALSE(axis->update());
    EXPECT_EQ(axis->status().state, kErrorStop) << axis->name();
    EXPECT_EQ(axis->status().drive.alarm, 0x21) << axis->name();
  }
  clock_.sleep_s(1);
  for (const auto& axis : axes_) {
    (void)axis->update();
    const auto reset = axis->reset();
    ASSERT_TRUE(reset) << reset.error().text();
    EXPECT_FALSE(axis->status().drive.servo_on) << axis->name();
    const double rest = axis->status().drive.position;
    ASSERT_TRUE(axis->enable());
    EXPECT_NEAR(axis->status().target, rest, 0.06) << "no jump";
    ASSERT_TRUE(axis->move_to(100));
  }
  finish(kDiscreteMotion);
  for (const auto& axis : axes_) EXPECT_NEAR(axis->status().drive.position, 100, 0.06) << axis->name();
  const BusStatistics statistics = modbus_bus_statistics(*bus_);
  EXPECT_EQ(statistics.timeouts + statistics.wrong_answers, 0) << statistics.last_error;
}

// Reads are repeated; nothing that starts a motion is. A lost answer to such a command is a fault of that
// axis.
TEST_F(FourKinds, LostAndDamagedAnswersOfReadsAreNotNoticed) {
  for (const auto& axis : axes_) ASSERT_TRUE(axis->connect());
  server_.wire_faults().reseed(3);
  int failures = 0;
  for (const WireFault fault : {WireFault::kDropReply, WireFault::kCorruptReply, WireFault::kTruncateReply})
    for (size_t axis = 0; axis < axes_.size(); ++axis) {
      server_.wire_faults().plan(fault, static_cast<int>(axis) + 1);
      failures += !axes_[axis]->update().has_value();
    }
  server_.wire_faults().clear();
  EXPECT_EQ(failures, 0) << modbus_bus_statistics(*bus_).last_error;
  EXPECT_GE(modbus_bus_statistics(*bus_).retries, 12);
}

}  // namespace
}  // namespace gantry
