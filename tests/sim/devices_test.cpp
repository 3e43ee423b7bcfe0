#include "gantry/sim/devices.h"

#include <gtest/gtest.h>

#include <cmath>

namespace gantry {
namespace {

/// One linear stage that carries a plate towards and away from the sensor at the base's origin.
class Devices : public testing::Test {
 protected:
  Devices() {
    Chain chain;
    Joint joint;
    joint.name = "linear";
    joint.kind = JointKind::kPrismatic;
    chain.joints = {joint};
    SimulationSettings settings;
    settings.sensor.width = 32;
    settings.sensor.height = 24;
    settings.sensor.noise_mm = settings.sensor.dropout_probability = settings.sensor.projector_offset_mm = 0;
    settings.sensor.mixed_pixel_probability = 0;
    settings.placement_sigma_mm = settings.placement_sigma_rad = 0;
    settings.stages = {{.travel_max = 200, .max_speed = 200, .max_acceleration = 1000, .homing_speed = 100}};
    const TriangleMesh plate = {{{-900, -900, 400}, {900, -900, 400}, {0, 900, 400}}, {{0, 2, 1}}};
    world_ = std::make_unique<SimulatedWorld>(chain, settings, plate, std::nullopt, 1, clock_);
    drive_ = make_simulated_drive("linear", *world_, 0);
    scanner_ = make_simulated_scanner(*world_);
  }

  void home() {
    ASSERT_TRUE(drive_->connect());
    ASSERT_TRUE(drive_->set_servo(true));
    ASSERT_TRUE(drive_->start_homing());
    clock_.sleep_s(30);
    ASSERT_TRUE(drive_->read_status()->homed);
  }

  VirtualClock clock_;
  std::unique_ptr<SimulatedWorld> world_;
  std::unique_ptr<Drive> drive_;
  std::unique_ptr<Scanner> scanner_;
};

TEST_F(Devices, TheDriveRefusesMotionWithoutServoAndNamesItself) {
  EXPECT_EQ(drive_->info().text(), "axis linear (simulated)");
  for (const auto& refused : {drive_->start_homing(), drive_->start_move({10, 100, 1000})}) {
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().kind, FaultKind::kRefused);
    EXPECT_NE(refused.error().text().find("axis linear"), std::string::npos);
  }
}

TEST_F(Devices, TheDriveShowsTheStageAtTheClocksTime) {
  home();
  ASSERT_TRUE(drive_->start_move({150, 100, 1000}));
  for (int i = 0; i < 30; ++i) {
    const DriveStatus status = *drive_->read_status();
    const StageState truth = world_->stage(0).observe(clock_.now_s());
    EXPECT_EQ(status.position, truth.encoder_position);
    EXPECT_EQ(status.moving, truth.moving);
    EXPECT_EQ(status.in_position, truth.in_position);
    EXPECT_EQ(status.sampled_at_s, clock_.now_s());
    clock_.sleep_s(0.1);
  }
  EXPECT_NEAR(drive_->read_status()->position, 150, 1e-9);
  EXPECT_TRUE(drive_->read_status()->in_position);
}

TEST_F(Devices, HaltAndServoOffReachTheStage) {
  home();
  for (const bool by_servo : {false, true}) {
    ASSERT_TRUE(drive_->start_move({180, 100, 1000}));
    clock_.sleep_s(0.5);
    if (by_servo)
      ASSERT_TRUE(drive_->set_servo(false));
    else
      ASSERT_TRUE(drive_->halt());
    clock_.sleep_s(1);
    const DriveStatus status = *drive_->read_status();
    EXPECT_FALSE(status.moving);
    EXPECT_FALSE(status.in_position);
    EXPECT_EQ(status.servo_on, !by_servo);
    EXPECT_GT(status.position, 30);
    EXPECT_LT(status.position, 120);
  }
}

TEST_F(Devices, TheScannerSeesWhatTheStageCarries) {
  home();
  ASSERT_TRUE(scanner_->connect());
  uint64_t frame = 0;
  for (const double position : {0.0, 75.0, 200.0}) {
    ASSERT_TRUE(drive_->start_move({position, 200, 1000}));
    clock_.sleep_s(10);
    const auto capture = scanner_->capture({.exposure_s = 0.02});
    ASSERT_TRUE(capture) << capture.error().text();
    EXPECT_GT(capture->frame_id, frame);
    frame = capture->frame_id;
    EXPECT_EQ(capture->exposure_s, 0.02);
    ASSERT_EQ(capture->scan.valid_count(), 32u * 24u);
    // The prismatic joint moves the part along z, away from the sensor.
    for (const auto& point : capture->scan.points) EXPECT_NEAR(point.z(), 400 + position, 1e-3);
  }
}

}  // namespace
}  // namespace gantry
