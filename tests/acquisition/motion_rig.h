#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gantry/acquisition/supervisor.h"
#include "gantry/sim/devices.h"

namespace gantry {

/// A drive whose wire can be cut: silent, it neither answers nor hears.
class CutDrive final : public Drive {
 public:
  explicit CutDrive(std::unique_ptr<Drive> inner) : inner_(std::move(inner)) {}
  const DriveInfo& info() const override { return inner_->info(); }
  Result<void> connect() override { return silent ? lost() : inner_->connect(); }
  Result<DriveStatus> read_status() override {
    if (silent) return tl::make_unexpected(lost().error());
    return inner_->read_status();
  }
  Result<void> set_servo(bool on) override { return silent ? lost() : inner_->set_servo(on); }
  Result<void> start_homing() override { return silent ? lost() : inner_->start_homing(); }
  Result<void> start_move(const MoveCommand& command) override {
    return silent ? lost() : inner_->start_move(command);
  }
  Result<void> halt() override { return silent ? lost() : inner_->halt(); }
  Result<void> reset_alarm() override { return silent ? lost() : inner_->reset_alarm(); }
  Result<void> set_communication_timeout(double timeout_s) override {
    return inner_->set_communication_timeout(timeout_s);
  }
  bool moves_unhomed() const override { return true; }

  bool silent = false;

 private:
  Result<void> lost() const { return fault(FaultKind::kTimeout, info().text(), "no answer"); }
  std::unique_ptr<Drive> inner_;
};

/// What a test demands of the axes.
class ScriptedPermit final : public MotionPermit {
 public:
  StopCategory required_stop(double, bool reset_requested) override {
    if (reset_requested) ++resets;
    return demanded;
  }
  std::string why() const override { return "the test demands it"; }
  StopCategory demanded = StopCategory::kNone;
  int resets = 0;
};

inline StageDynamics rig_stage() {
  StageDynamics stage;
  stage.travel_min = -20;
  stage.travel_max = 320;
  stage.max_speed = 200;
  stage.max_acceleration = 1000;
  stage.homing_speed = 100;
  stage.encoder_resolution = 0.001;
  stage.settling_time_s = 0.1;
  stage.homing = HomingMethod::kSwitch;
  stage.back_off = 2;
  stage.lower_limit = -8;
  stage.upper_limit = 308;
  stage.following_lag_s = 0.002;
  return stage;
}

inline AxisLimits rig_limits() {
  AxisLimits limits;
  limits.lower = 0;
  limits.upper = 300;
  limits.speed = 120;
  limits.acceleration = 600;
  limits.in_position = 0.05;
  limits.jog_speed = 30;
  limits.unhomed_jog_speed = 5;
  limits.following_error = 2;
  limits.following_error_at_rest = 1;
  limits.following_error_time_s = 0.05;
  return limits;
}

/// Three simulated linear stages under a Supervisor, on a virtual clock and in one thread.
class MotionRig {
 public:
  explicit MotionRig(uint64_t seed, const StageDynamics& stage = rig_stage(),
                     const AxisLimits& limits = rig_limits()) {
    Chain chain;
    SimulationSettings settings;
    for (const char* name : {"x", "y", "z"}) {
      Joint joint;
      joint.name = name;
      joint.kind = JointKind::kPrismatic;
      chain.joints.push_back(joint);
      settings.stages.push_back(stage);
    }
    const TriangleMesh plate = {{{-900, -900, 400}, {900, -900, 400}, {0, 900, 400}}, {{0, 2, 1}}};
    world = std::make_unique<SimulatedWorld>(chain, settings, plate, std::nullopt, seed, clock);
    std::vector<Axis*> pointers;
    for (size_t i = 0; i < kAxes; ++i) {
      auto drive = std::make_unique<CutDrive>(make_simulated_drive(chain.joints[i].name, *world, i));
      drives[i] = drive.get();
      axes.push_back(std::make_unique<Axis>(std::move(drive), AxisKind::kLinear, limits, clock));
      pointers.push_back(axes.back().get());
    }
    supervisor = std::make_unique<Supervisor>(pointers, SupervisorSettings{}, &permit);
    step();
  }

  void step() {
    clock.sleep_s(supervisor->settings().period_s);
    for (auto& axis : axes) axis->channel().service();
    supervisor->tick(clock.now_s());
  }
  void steps(int count) {
    for (int i = 0; i < count; ++i) step();
  }
  /// Sends the request and lets it be answered.
  AxisRefusal request(AxisTrigger command, AxisSet set = 7, std::array<MoveCommand, kMaxAxes> moves = {},
                      bool hold = false) {
    MotionRequest request;
    request.command = command;
    request.axes = set;
    request.moves = moves;
    request.hold_to_run = hold;
    EXPECT_NE(supervisor->request(request), 0u);
    step();
    return supervisor->status().refusal;
  }
  AxisState state(size_t axis) const { return supervisor->status().axes[axis].state; }
  bool all(AxisState state_wanted) const {
    for (size_t i = 0; i < kAxes; ++i)
      if (state(i) != state_wanted) return false;
    return true;
  }
  StageState truth(size_t axis) { return world->stage(axis).observe(clock.now_s()); }
  bool at_rest() {
    for (size_t i = 0; i < kAxes; ++i)
      if (std::abs(truth(i).velocity) > 1e-9) return false;
    return true;
  }
  void home() {
    ASSERT_EQ(request(AxisTrigger::kEnable), AxisRefusal::kNone);
    steps(5);
    ASSERT_EQ(request(AxisTrigger::kHome), AxisRefusal::kNone);
    for (int i = 0; i < 3000 && !all(AxisState::kStandstill); ++i) step();
    ASSERT_TRUE(all(AxisState::kStandstill));
  }
  static std::array<MoveCommand, kMaxAxes> to(double x, double y, double z, double speed = 120) {
    std::array<MoveCommand, kMaxAxes> moves{};
    moves[0] = {x, speed, 600};
    moves[1] = {y, speed, 600};
    moves[2] = {z, speed, 600};
    return moves;
  }

  static constexpr size_t kAxes = 3;
  VirtualClock clock;
  std::unique_ptr<SimulatedWorld> world;
  CutDrive* drives[kAxes] = {};
  std::vector<std::unique_ptr<Axis>> axes;
  ScriptedPermit permit;
  std::unique_ptr<Supervisor> supervisor;
};

}  // namespace gantry
