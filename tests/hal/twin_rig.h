#pragma once

#include <numbers>
#include <optional>
#include <string>

#include "gantry/hal/modbus_drives.h"
#include "gantry/sim/twin/modbus_drives.h"
#include "hal/axis_conformance.h"

namespace gantry {

/// An axis on a drive of the twin: both on one virtual clock, between them Modbus TCP on loopback.
class TwinRig final : public AxisRig {
 public:
  /// `counts` per mm or rad of the drive; 0 where it fixes them itself.
  TwinRig(const std::string& profile, AxisKind kind, double counts, const StageDynamics& dynamics,
          const AxisLimits& limits)
      : stage_(dynamics, 11), server_("127.0.0.1", 0, clock_) {
    server_.add({profile, kUnit, counts > 0 ? 1.0 / counts : 0.01}, stage_);
    server_.start();
    ModbusDriveConfig config;
    config.axis = kind == AxisKind::kRotary ? "tilt" : "linear";
    config.kind = kind;
    config.profile = profile;
    config.host = "127.0.0.1";
    config.port = server_.port();
    config.unit = kUnit;
    config.counts_per_axis_unit = counts;
    config.in_position = limits.in_position;
    config.response_timeout_s = 2.0;  // Loaded test machines; nothing here is about time-outs.
    axis_.emplace(make_modbus_drive(config, nullptr, clock_), kind, limits, clock_);
  }

  Axis& axis() override { return *axis_; }
  Clock& clock() override { return clock_; }
  bool raise_alarm() override {
    server_.raise_alarm(kUnit, 0x30);
    return true;
  }
  bool set_emergency_stop(bool active) override {
    server_.set_emergency_stop(kUnit, active);
    return true;
  }

 private:
  static constexpr int kUnit = 3;
  VirtualClock clock_;
  SimulatedStage stage_;
  ModbusDriveServer server_;
  std::optional<Axis> axis_;
};

}  // namespace gantry
