#pragma once

#include <cstdint>
#include <optional>

#include "gantry/sim/stage.h"
#include "twin_drive.h"

namespace gantry {

/// Kinco FD servo drive: the state machine, profile position mode and homing mode of CiA 402, each object at
/// a Modbus address of its own. A 32-bit object takes two registers, lower word first (manual 12.3: 00085555
/// travels as 55 55 00 08); a 16-bit one may be read as two (example 01 03 32 00 00 02).
///
/// | address | object |   | address | object |
/// |---|---|---|---|---|
/// | 3100 | 6040 control word | | 4000 | 607A target position |
/// | 3200 | 6041 status word | | 4A00 | 6081 profile velocity |
/// | 3400 | 605A quick stop option | | 4B00, 4C00 | 6083, 6084 acceleration, deceleration |
/// | 3500 | 6060 mode of operation | | 4D00 | 6098 homing method |
/// | 3700 | 6064 actual position | | 6D00 | 60FD digital inputs: b0, b1 limits, b3 hardware lock |
/// | 3B00 | 606C actual velocity | | 1F00 | error state |
///
/// Units: counts; DEC of velocity = rpm * 512 * counts per turn / 1875; DEC of acceleration = turns/s^2 *
/// 65536 * counts per turn / 4000000. Not checked against a manual: error codes, that moves are possible
/// before homing, that a hardware lock leads to "switch on disabled", and the vendor's own meaning of 605A.
class KincoFd final : public TwinDrive {
 public:
  KincoFd(SimulatedStage& stage, double axis_units_per_count);

  bool serves(int function) const override;
  ModbusAnswer<std::vector<uint16_t>> read_registers(int address, int count, double now_s) override;
  ModbusAnswer<std::vector<uint8_t>> read_bits(int address, int count, double now_s) override;
  ModbusAnswer<void> write_bit(int address, bool on, double now_s) override;
  ModbusAnswer<void> write_registers(int address, std::span<const uint16_t> words, double now_s) override;

  void raise_alarm(int code, bool persists, double now_s) override;
  void clear_alarm_cause() override { error_persists_ = false; }
  void set_emergency_stop(bool active, double now_s) override;

 private:
  enum class Power { kSwitchOnDisabled, kReady, kSwitchedOn, kEnabled, kQuickStop, kFault };

  std::optional<int32_t> object(int address, const StageState& state) const;
  uint16_t status_word(const StageState& state) const;
  int32_t position(const StageState& state) const;
  void set_control_word(uint16_t word, double now_s);
  void change_power(uint16_t word, double now_s);
  void enter(Power power, double now_s);
  void quick_stop(double now_s);
  void take_set_point(double now_s);
  void start_move(double now_s);
  void catch_up(double now_s);

  SimulatedStage& stage_;
  double axis_units_per_count_;
  Power power_ = Power::kSwitchOnDisabled;
  uint16_t control_ = 0;
  int32_t mode_ = 1;
  int32_t quick_stop_option_ = 2;
  int32_t homing_method_ = 0;
  int32_t target_ = 0;
  int32_t velocity_ = 0, acceleration_ = 0, deceleration_ = 0;  ///< DEC, unsigned on the wire.
  std::optional<int32_t> set_point_;  ///< What the drive travels to or stands at by profile position.
  bool acknowledged_ = false;         ///< Status b12 in profile position mode.
  bool set_point_waits_ = false;      ///< For the end of the present motion: not "change at once".
  bool hits_the_end_ = false;
  int error_ = 0;
  bool error_persists_ = false;
  bool locked_ = false;
};

}  // namespace gantry
