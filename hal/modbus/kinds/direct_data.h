#pragma once

#include "modbus/register_drive.h"

namespace gantry {

/// Kind `direct_data` (Oriental Motor AZ): motion by direct data operation, everything else by the bits of an
/// input command word. The motor is energised from power-on; FREE takes its current away.
class DirectDataDrive final : public RegisterDrive {
 public:
  using RegisterDrive::RegisterDrive;

  Result<void> connect() override;
  Result<DriveStatus> read_status() override;
  Result<void> set_servo(bool on) override;
  Result<void> start_homing() override;
  Result<void> start_move(const MoveCommand& command) override;
  Result<void> halt() override;
  Result<void> reset_alarm() override;

 private:
  uint32_t input_mask(const char* name) const { return 1u << profile_.bit(name).bit; }
  Result<StatusImage> read_and_note_free();
  Result<void> write_input(uint32_t bits, WriteHandling handling = {});
  Result<void> become_ready(const char* command);

  bool motor_free_ = false;  ///< FREE, as last read or written.
};

}  // namespace gantry
