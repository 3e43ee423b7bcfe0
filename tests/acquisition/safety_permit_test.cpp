// The safety chain from the contact to the motor: contacts of the twin, Modbus TCP, channel, chain, permit;
// and a supervisor small enough to be read here, which obeys the permit on a simulated stage.

#include "gantry/acquisition/safety_permit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "gantry/hal/modbus_safety_inputs.h"
#include "gantry/sim/stage.h"
#include "gantry/sim/twin/modbus_drives.h"

namespace gantry {
namespace {

constexpr double kCycle_s = 0.01;

SafetySettings demo_settings() {
  SafetySettings settings;
  settings.inputs = {{"emergency stop", {0, 1}, StopCategory::kCategory0, 0.1, 0.05},
                     {"door", {2, 3}, StopCategory::kCategory1, 0.5, 0.1}};
  settings.ramp_limit_s = 2;
  return settings;
}

/// Asks the permit in every cycle and does what it says: category 0 takes the torque at once, category 1
/// halts and takes it at rest. Nothing moves again by itself.
class SmallSupervisor {
 public:
  SmallSupervisor(MotionPermit& permit, SimulatedStage& stage) : permit_(permit), stage_(stage) {}

  bool enable(double now_s) {
    if (stop_ != StopCategory::kNone) return false;
    stage_.set_servo(true, now_s);
    return true;
  }

  void tick(double now_s, bool reset) {
    const StopCategory stop = permit_.required_stop(now_s, reset);
    if (stop == StopCategory::kCategory0) stage_.set_servo(false, now_s);
    if (stop == StopCategory::kCategory1) {
      if (stop_ == StopCategory::kNone) stage_.halt(now_s);
      if (!stage_.observe(now_s).moving) stage_.set_servo(false, now_s);
    }
    stop_ = stop;
  }

 private:
  MotionPermit& permit_;
  SimulatedStage& stage_;
  StopCategory stop_ = StopCategory::kCategory0;
};

struct Cell {
  Cell() {
    server.add_io_module(10, contacts);
    server.start();
    ModbusSafetyInputsConfig config;
    config.host = "127.0.0.1";
    config.port = server.port();
    config.unit = 10;
    config.channels = {0, 1, 2, 3};
    config.response_timeout_s = 2;  // Loaded test machines.
    channel = std::make_shared<SafetyInputsChannel>(make_modbus_safety_inputs(config, nullptr), clock);
    permit.emplace(demo_settings(), channel);
    supervisor.emplace(*permit, stage);
  }

  void run(double duration_s, bool reset = false) {
    for (double t = 0; t < duration_s - 1e-9; t += kCycle_s) {
      clock.sleep_s(kCycle_s);
      if (connected) channel->service();
      supervisor->tick(clock.now_s(), reset);
    }
  }
  void become_ready() {
    run(0.3);
    run(kCycle_s, true);
    run(kCycle_s);
    ASSERT_TRUE(permit->verdict().motion_allowed) << permit->why();
    ASSERT_TRUE(supervisor->enable(clock.now_s()));
    stage.start_homing(clock.now_s());
    run(5);
    ASSERT_TRUE(stage.observe(clock.now_s()).homed);
    stage.start_move(280, 100, 400, clock.now_s());
    run(0.8);
    ASSERT_GT(state().velocity, 90);
  }
  StageState state() { return stage.observe(clock.now_s()); }

  VirtualClock clock;
  SafetyContacts contacts{{{"emergency stop", {0, 1}}, {"door", {2, 3}}}, clock};
  ModbusDriveServer server{"127.0.0.1", 0, clock};
  SimulatedStage stage{{.travel_min = 0,
                        .travel_max = 300,
                        .max_speed = 200,
                        .max_acceleration = 1000,
                        .homing_speed = 100,
                        .encoder_resolution = 0.01},
                       3};
  std::shared_ptr<SafetyInputsChannel> channel;
  std::optional<SafetyPermit> permit;
  std::optional<SmallSupervisor> supervisor;
  bool connected = true;
};

TEST(SafetyPermit, NothingIsEnabledBeforeAReset) {
  Cell cell;
  cell.run(1);
  EXPECT_FALSE(cell.supervisor->enable(cell.clock.now_s()));
  EXPECT_EQ(cell.permit->why(), "waiting for a reset because the program has started");
}

TEST(SafetyPermit, EmergencyStopTakesTheTorqueInTheNextCycle) {
  Cell cell;
  cell.become_ready();
  cell.contacts.press("emergency stop", 0.004);
  cell.run(kCycle_s);
  EXPECT_FALSE(cell.state().servo_on);
  EXPECT_EQ(cell.permit->why(), "emergency stop is tripped; release it, then reset");
  cell.contacts.release("emergency stop");
  cell.run(1);
  EXPECT_FALSE(cell.supervisor->enable(cell.clock.now_s())) << "released is not reset";
  EXPECT_EQ(cell.permit->why(), "waiting for a reset because emergency stop was tripped");
  cell.run(kCycle_s, true);
  EXPECT_EQ(cell.permit->last_reset(), SafetyReset::kAccepted);
  cell.run(0.1);
  EXPECT_FALSE(cell.state().servo_on) << "a reset starts nothing";
  EXPECT_TRUE(cell.supervisor->enable(cell.clock.now_s()));
}

TEST(SafetyPermit, TheDoorRampsDownAndTakesTheTorqueAtRest) {
  Cell cell;
  cell.become_ready();
  const double opened_at = cell.state().true_position;
  cell.contacts.press("door");
  cell.run(2 * kCycle_s);
  EXPECT_TRUE(cell.state().servo_on) << "under power while it brakes";
  EXPECT_LT(cell.state().velocity, 100);
  cell.run(0.6);
  EXPECT_FALSE(cell.state().servo_on);
  EXPECT_LT(cell.state().true_position - opened_at, 15) << "v^2 / 2a and a cycle";
  EXPECT_EQ(cell.permit->verdict().stop, StopCategory::kCategory1);
  cell.run(1.5);
  EXPECT_EQ(cell.permit->verdict().stop, StopCategory::kCategory0);
}

TEST(SafetyPermit, ABrokenWireStopsAndIsNamedAsAFaultOfTheInput) {
  Cell cell;
  cell.become_ready();
  cell.contacts.break_wire(1);
  cell.run(kCycle_s);
  EXPECT_FALSE(cell.state().servo_on);
  cell.run(0.2);
  EXPECT_NE(cell.permit->why().find("its two channels disagreed"), std::string::npos) << cell.permit->why();
  cell.contacts.mend(1);
  cell.run(1);
  cell.run(kCycle_s, true);
  EXPECT_EQ(cell.permit->last_reset(), SafetyReset::kRefused);
  cell.contacts.press("emergency stop");
  cell.run(0.1);
  cell.contacts.release("emergency stop", 0.03);
  cell.run(0.5);
  cell.run(kCycle_s, true);
  EXPECT_EQ(cell.permit->last_reset(), SafetyReset::kAccepted);
}

TEST(SafetyPermit, AStuckContactIsFoundWhenItIsUsed) {
  Cell cell;
  cell.become_ready();
  cell.contacts.stick(0);
  cell.run(1);
  EXPECT_TRUE(cell.permit->verdict().motion_allowed) << "nothing shows until the button is pressed";
  cell.contacts.press("emergency stop");
  cell.run(kCycle_s);
  EXPECT_FALSE(cell.state().servo_on) << "the other channel stops";
  cell.run(0.2);
  cell.contacts.release("emergency stop");
  cell.run(1);
  cell.run(kCycle_s, true);
  EXPECT_EQ(cell.permit->last_reset(), SafetyReset::kRefused);
  EXPECT_EQ(cell.permit->verdict().cause, SafetyCause::kDiscrepancy);
}

TEST(SafetyPermit, ALostModuleStopsWithinTheAgeLimit) {
  Cell cell;
  cell.become_ready();
  cell.connected = false;  // nobody reads any more
  cell.run(0.09);
  EXPECT_TRUE(cell.permit->verdict().motion_allowed);
  cell.run(0.03);
  EXPECT_FALSE(cell.state().servo_on) << "the highest category of all inputs";
  EXPECT_NE(cell.permit->why().find("have not been read for more than 100 ms"), std::string::npos);
}

TEST(SafetyPermit, AnUnreachableModuleIsNamedWithItsLastFault) {
  VirtualClock clock;
  ModbusSafetyInputsConfig config;
  config.host = "127.0.0.1";
  config.port = 9;  // discard: nobody listens
  config.channels = {0, 1, 2, 3};
  const auto channel =
      std::make_shared<SafetyInputsChannel>(make_modbus_safety_inputs(config, nullptr), clock);
  SafetyPermit permit(demo_settings(), channel);
  channel->service();
  EXPECT_EQ(permit.required_stop(clock.now_s(), false), StopCategory::kCategory0);
  EXPECT_NE(permit.why().find("127.0.0.1:9 unit 1"), std::string::npos) << permit.why();
}

}  // namespace
}  // namespace gantry
