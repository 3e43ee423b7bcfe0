#include "gantry/sim/devices.h"

#include <limits>
#include <optional>

namespace gantry {
namespace {

class SimulatedDrive final : public Drive {
 public:
  SimulatedDrive(const std::string& axis, SimulatedWorld& world, size_t index)
      : info_{axis, "simulated", ""}, stage_(world.stage(index)), clock_(world.clock()) {}

  const DriveInfo& info() const override { return info_; }
  Result<void> connect() override { return {}; }

  Result<DriveStatus> read_status() override {
    const double now_s = hear();
    const StageState state = stage_.observe(now_s);
    if (state.homing_failure != HomingFailure::kNone && state.homing_failure != reset_failure_) {
      // As a drive does: it gives up, says why, and drops the servo until it is reset.
      alarm_ = state.homing_failure == HomingFailure::kLimitSwitch ? kAlarmHomingLimit : kAlarmNoHomeSwitch;
      stage_.set_servo(false, now_s);
    }
    if (state.homing_failure == HomingFailure::kNone) reset_failure_ = HomingFailure::kNone;
    DriveStatus status;
    status.position = state.encoder_position;
    status.servo_on = state.servo_on && !alarm_;
    status.homed = state.homed;
    status.moving = state.moving;
    status.in_position = state.in_position;
    status.alarm = alarm_;
    status.following_error = state.following_error;
    status.lower_limit = state.lower_limit;
    status.upper_limit = state.upper_limit;
    status.sampled_at_s = now_s;
    return status;
  }

  Result<void> set_servo(bool on) override {
    const double now_s = hear();
    if (on && alarm_)
      return fault(FaultKind::kAlarm, info_.text(), "servo on refused: an alarm is pending; reset it first");
    stage_.set_servo(on, now_s);
    return {};
  }

  Result<void> start_homing() override {
    if (!stage_.start_homing(hear())) return servo_is_off("homing");
    return {};
  }

  Result<void> start_move(const MoveCommand& command) override {
    const double now_s = hear();
    // The stage counts from home; before homing the encoder is off by what only the stage knows.
    const StageState state = stage_.observe(now_s);
    const double offset = state.homed ? 0 : state.encoder_position - state.true_position;
    if (!stage_.start_move(command.target - offset, command.speed, command.acceleration, now_s))
      return servo_is_off("move");
    return {};
  }

  Result<void> halt() override {
    stage_.halt(hear());
    return {};
  }

  Result<void> reset_alarm() override {
    reset_failure_ = stage_.observe(hear()).homing_failure;
    alarm_.reset();
    return {};
  }

  Result<void> set_communication_timeout(double timeout_s) override {
    timeout_s_ = timeout_s;
    hear();
    return {};
  }
  bool moves_unhomed() const override { return true; }

 private:
  static constexpr int kAlarmNoHomeSwitch = 1, kAlarmHomingLimit = 2;

  // Any exchange keeps the drive from stopping by itself.
  double hear() {
    const double now_s = clock_.now_s();
    const double never_s = std::numeric_limits<double>::infinity();
    stage_.halt_unless_kept_alive(timeout_s_ > 0 ? now_s + timeout_s_ : never_s, now_s);
    return now_s;
  }
  Result<void> servo_is_off(const std::string& command) const {
    return fault(FaultKind::kRefused, info_.text(), command + " refused: the servo is off");
  }

  DriveInfo info_;
  SimulatedStage& stage_;
  Clock& clock_;
  std::optional<int> alarm_;
  HomingFailure reset_failure_ = HomingFailure::kNone;  ///< Known, and acknowledged by a reset.
  double timeout_s_ = 0;
};

class SimulatedScanner final : public Scanner {
 public:
  explicit SimulatedScanner(SimulatedWorld& world) : world_(world) {
    info_.vendor = "Gantry";
    info_.model = "simulated";
    info_.serial = "in-process";
    info_.firmware = "none";
    info_.width = world.sensor().width;
    info_.height = world.sensor().height;
  }

  const ScannerInfo& info() const override { return info_; }

  Result<void> connect() override {
    connected_ = true;
    return {};
  }

  Result<Capture> capture(const CaptureSettings& settings) override {
    if (!connected_) return fault(FaultKind::kRefused, info_.text(), "capture before connect");
    constexpr double kMin_s = 0.001, kMax_s = 10.0;
    if (!(settings.exposure_s >= kMin_s && settings.exposure_s <= kMax_s))
      return fault(FaultKind::kRefused, info_.text(),
                   "exposure of " + std::to_string(settings.exposure_s) + " s is outside 0.001 to 10 s");
    Capture capture;
    capture.scan = world_.expose(settings.exposure_s);
    capture.frame_id = ++frames_;
    capture.device_timestamp_ns = static_cast<uint64_t>(world_.clock().now_s() * 1e9);
    capture.exposure_s = settings.exposure_s;
    return capture;
  }

 private:
  SimulatedWorld& world_;
  ScannerInfo info_;
  bool connected_ = false;
  uint64_t frames_ = 0;
};

}  // namespace

std::unique_ptr<Drive> make_simulated_drive(const std::string& axis, SimulatedWorld& world, size_t index) {
  return std::make_unique<SimulatedDrive>(axis, world, index);
}

std::unique_ptr<Scanner> make_simulated_scanner(SimulatedWorld& world) {
  return std::make_unique<SimulatedScanner>(world);
}

}  // namespace gantry
