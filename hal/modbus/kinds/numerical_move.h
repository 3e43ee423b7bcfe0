#pragma once

#include "modbus/register_drive.h"

namespace gantry {

/// Kind `numerical_move` (IAI ROBO Cylinder): power, homing, stop and reset by coils; one block of registers
/// is a move, and writing it starts that move (IAI 5.6.1). Counts mm whatever its lead.
class NumericalMoveDrive final : public RegisterDrive {
 public:
  using RegisterDrive::RegisterDrive;

  Result<DriveStatus> read_status() override;
  Result<void> set_servo(bool on) override;
  Result<void> start_homing() override;
  Result<void> start_move(const MoveCommand& command) override;
  Result<void> halt() override;
  Result<void> reset_alarm() override;

 private:
  Result<double> position_unless_paused() const;
};

}  // namespace gantry
