#pragma once

#include <optional>

#include "gantry/foundation/clock.h"
#include "gantry/hal/drive.h"
#include "modbus/modbus_unit.h"
#include "modbus/start_watch.h"

namespace gantry {

/// IAI ROBO Cylinder: servo and homing by coils, motion by the numerical movement command (IAI 5.6.1).
class IaiRoboCylinderDrive final : public Drive {
 public:
  static constexpr const char* kModel = "IAI ROBO Cylinder";
  static constexpr double kCountsPerMm = 100;

  IaiRoboCylinderDrive(ModbusUnit unit, double in_position_mm, Clock& clock);

  const DriveInfo& info() const override { return unit_.info(); }
  Result<void> connect() override;
  Result<DriveStatus> read_status() override;
  Result<void> set_servo(bool on) override;
  Result<void> start_homing() override;
  Result<void> start_move(const MoveCommand& command) override;
  Result<void> halt() override;
  Result<void> reset_alarm() override;

 private:
  Result<int32_t> position_unless_paused() const;
  void forget_motion();

  ModbusUnit unit_;
  int32_t in_position_counts_;
  Clock& clock_;
  std::optional<int32_t> target_counts_;  ///< Of the last move, unless something ended it early.
  StartWatch start_;
};

}  // namespace gantry
