#pragma once

#include "modbus/register_drive.h"

namespace gantry {

/// Kind `pr_path` (Leadshine CS2RS and relatives in PR mode): one block of registers is path 0 with its
/// trigger
/// ("immediate trigger", manual 5.5.4); a trigger register starts homing and stops. Speeds are rpm of the
/// motor, accelerations the milliseconds that 1000 rpm take.
class PrPathDrive final : public RegisterDrive {
 public:
  PrPathDrive(DriveProfile profile, ModbusUnit unit, const Options& options,
              double counts_per_motor_revolution, Clock& clock);

  /// Refuses a drive that counts another number of pulses per revolution than it was told.
  Result<void> connect() override;
  Result<DriveStatus> read_status() override;
  Result<void> set_servo(bool on) override;
  Result<void> start_homing() override;
  Result<void> start_move(const MoveCommand& command) override;
  Result<void> halt() override;
  Result<void> reset_alarm() override;

 private:
  Result<void> require_enabled(const char* command) const;
  double rpm(double axis_units_per_s) const;

  const double counts_per_motor_revolution_;
};

}  // namespace gantry
