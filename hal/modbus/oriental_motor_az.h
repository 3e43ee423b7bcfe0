#pragma once

#include <optional>

#include "gantry/foundation/clock.h"
#include "gantry/hal/drive.h"
#include "modbus/modbus_unit.h"
#include "modbus/start_watch.h"

namespace gantry {

/// Oriental Motor AZ: motion by direct data operation, everything else by the input command word.
class OrientalMotorAzDrive final : public Drive {
 public:
  static constexpr const char* kModel = "Oriental Motor AZ";

  OrientalMotorAzDrive(ModbusUnit unit, double steps_per_axis_unit, Clock& clock);

  const DriveInfo& info() const override { return unit_.info(); }
  Result<void> connect() override;
  Result<DriveStatus> read_status() override;
  Result<void> set_servo(bool on) override;
  Result<void> start_homing() override;
  Result<void> start_move(const MoveCommand& command) override;
  Result<void> halt() override;
  Result<void> reset_alarm() override;

 private:
  struct Words {
    uint16_t input;   ///< Input command word as the drive has it.
    uint16_t output;  ///< Output status word.
    int32_t alarm;
  };
  Result<Words> read_words();
  Result<void> write_input(uint16_t bits);
  Result<void> become_ready(const char* command);
  void forget_motion();

  ModbusUnit unit_;
  double steps_per_axis_unit_;
  Clock& clock_;
  std::optional<int32_t> target_steps_;  ///< Of the last move, unless something ended it early.
  bool motor_free_ = false;              ///< FREE, as last read or written.
  StartWatch start_;
};

}  // namespace gantry
