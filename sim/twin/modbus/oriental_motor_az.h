#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "gantry/sim/stage.h"
#include "twin_drive.h"

namespace gantry {

/// Oriental Motor AZ with built-in controller: direct data operation over Modbus. Each item is 32 bits, upper
/// word at the even address, lower word at the odd one.
///
/// | addresses | what | manual (HM-60262E) |
/// |---|---|---|
/// | 0058-0067 | direct data: number, type, position, speed, two rates, current, trigger | direct data
/// operation | | 007C, 007D | driver input command, R-IN0 to R-IN15 in the lower word | input signals | |
/// 007E, 007F | driver output status, R-OUT0 to R-OUT15 in the lower word | output signals | | 0080 | present
/// alarm | monitor commands (general knowledge) | | 00C6, 00CC, 00D0 | command position, feedback position,
/// feedback speed in Hz | monitor commands | | 0120, 0122 | 32-bit counters of feedback and command position
/// | monitor commands |
///
/// Homed is R-OUT4, assigned to ABSPEN. Not checked against the manual: exception 04 for values outside
/// their setting range, that every alarm removes the motor current, and the START input without stored data.
class OrientalMotorAz final : public TwinDrive {
 public:
  /// The motor is energised from power-on.
  /// `communication_timeout_address`: of the upper word of that parameter, milliseconds; 0: it has none.
  OrientalMotorAz(SimulatedStage& stage, double axis_units_per_step, double now_s,
                  int communication_timeout_address = 0);

  bool serves(int function) const override;
  ModbusAnswer<std::vector<uint16_t>> read_registers(int address, int count, double now_s) override;
  ModbusAnswer<std::vector<uint8_t>> read_bits(int address, int count, double now_s) override;
  ModbusAnswer<void> write_bit(int address, bool on, double now_s) override;
  ModbusAnswer<void> write_registers(int address, std::span<const uint16_t> words, double now_s) override;

  /// Alarm 85 when it has heard nothing for longer than its time-out.
  void heard(double now_s) override;
  void raise_alarm(int code, bool persists, double now_s) override;
  void clear_alarm_cause() override { alarm_persists_ = false; }
  void set_emergency_stop(bool active, double now_s) override;

 private:
  enum Item { kNumber, kType, kPosition, kSpeed, kStartRate, kStopRate, kCurrent, kTrigger, kItems };

  std::optional<int32_t> item(int even_address, const StageState& state) const;
  uint16_t outputs(const StageState& state) const;
  int32_t feedback_steps(const StageState& state) const;
  int32_t command_steps(const StageState& state) const;
  /// What happens in the drive without a request: the alarm at the end of an overtravelling move.
  void catch_up(double now_s);
  ModbusAnswer<void> write_direct_data(int address, std::span<const uint16_t> words, double now_s);
  void start_direct_operation(double now_s);
  void apply_inputs(uint16_t inputs, double now_s);
  bool may_start() const;
  void energise(double now_s);
  void power_off(double now_s);

  SimulatedStage& stage_;
  double axis_units_per_step_;
  std::array<int32_t, kItems> direct_{0, 2, 0, 1000, 1'000'000, 1'000'000, 1000, 0};
  uint16_t inputs_ = 0;
  std::optional<int32_t>
      command_;  ///< Steps; empty where the command position is simply where the motor stands.
  bool overtravelling_ = false;  ///< The present move ends at the travel limit, short of its target.
  int alarm_ = 0;
  bool alarm_persists_ = false;
  bool emergency_stop_ = false;
  int communication_timeout_address_;
  int32_t communication_timeout_ms_ = 0;
  double heard_at_s_;
};

}  // namespace gantry
