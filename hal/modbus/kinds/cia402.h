#pragma once

#include "modbus/register_drive.h"

namespace gantry {

/// Kind `cia402`: the power state machine, profile position mode and homing mode of CiA 402 (IEC
/// 61800-7-201), its objects mapped to Modbus registers by the profile.
///
/// Halting is a quick stop that stays under power (quick stop option code 5 or 6; the drive is told where the
/// profile knows its register), not the halt bit: when that is taken back, a drive may run on to its old
/// target.
class Cia402Drive final : public RegisterDrive {
 public:
  using RegisterDrive::RegisterDrive;

  Result<DriveStatus> read_status() override;
  Result<void> set_servo(bool on) override;
  Result<void> start_homing() override;
  Result<void> start_move(const MoveCommand& command) override;
  Result<void> halt() override;
  Result<void> reset_alarm() override;

 private:
  Result<uint16_t> read_status_word() const;
  Result<void> control(uint16_t word, WriteHandling handling = {}) const;
  /// Polls the status word until `reached` likes it; refused, with the state named, when it never does.
  Result<void> await(const char* what, bool (*reached)(uint16_t status_word)) const;
  /// From standing by after a quick stop back to operation; refused where the motor has no power.
  Result<void> become_operational(const char* command) const;

  std::optional<double> halted_at_s_;
};

}  // namespace gantry
