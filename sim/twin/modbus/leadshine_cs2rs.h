#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "gantry/sim/stage.h"
#include "twin_drive.h"

namespace gantry {

/// Leadshine CS2RS closed-loop stepper drive in PR mode. Parameters are 32 bits wide and have two addresses,
/// of which the odd one, the lower word, holds the value (manual 4.3.1); the status registers are single.
///
/// | addresses | what | manual (CS2RS user manual) |
/// |---|---|---|
/// | 0000, 0001 Pr0.00 | pulses per revolution | 4.3.1 |
/// | 000E, 000F Pr0.07 | forced enable by software; overrules the enable input | 4.3.1 |
/// | 1003 | status: b0 fault, b1 enabled, b2 running, b4 command done, b5 path done, b6 homed | |
/// | 1801 | auxiliary control word, 1111 resets an alarm | 4.2.4 |
/// | 2203 | present alarm | 4.4.2 |
/// | 6002 Pr8.02 | trigger: 10 path 0, 20 home, 40 stop | |
/// | 602A, 602C, 602E | command position, motor position, digital inputs | 4.5 (602E), unchecked (602A) |
/// | 6200-6207 Pr9.00-Pr9.07 | path 0: mode, position (2), rpm, two ramps, delay, trigger | 5.5.4 |
///
/// Not checked against a manual: the alarm codes, that moves are possible before homing, that a stop leaves
/// "path done" off, and what the quick stop input does beyond stopping (here: power off, enable taken back).
class LeadshineCs2rs final : public TwinDrive {
 public:
  LeadshineCs2rs(SimulatedStage& stage, double axis_units_per_pulse);

  bool serves(int function) const override;
  ModbusAnswer<std::vector<uint16_t>> read_registers(int address, int count, double now_s) override;
  ModbusAnswer<std::vector<uint8_t>> read_bits(int address, int count, double now_s) override;
  ModbusAnswer<void> write_bit(int address, bool on, double now_s) override;
  ModbusAnswer<void> write_registers(int address, std::span<const uint16_t> words, double now_s) override;

  void raise_alarm(int code, bool persists, double now_s) override;
  void clear_alarm_cause() override { alarm_persists_ = false; }
  void set_emergency_stop(bool active, double now_s) override;

 private:
  std::optional<uint16_t> word_at(int address, const StageState& state) const;
  uint16_t status(const StageState& state) const;
  uint16_t inputs(const StageState& state) const;
  int32_t position(const StageState& state) const;
  bool powered() const { return forced_enable_ && alarm_ == 0 && !emergency_stop_; }
  bool accepts(int address, uint16_t word) const;
  void write_word(int address, uint16_t word, double now_s);
  void trigger(uint16_t word, double now_s);
  void run_path(double now_s);
  void follow_power(double now_s);
  void catch_up(double now_s);

  SimulatedStage& stage_;
  double axis_units_per_pulse_;
  uint16_t pulses_per_revolution_ = 10000;
  bool forced_enable_ = false;
  std::array<uint16_t, 8> path_{1, 0, 0, 60, 100, 100, 0, 0};
  std::optional<int32_t> command_;  ///< Pulses; empty where it is simply where the motor stands.
  bool path_completes_ = false;  ///< The present motion, or the last one, ends or ended as it was meant to.
  bool hits_the_end_ = false;    ///< The present path goes beyond the travel.
  int alarm_ = 0;
  bool alarm_persists_ = false;
  bool emergency_stop_ = false;
};

}  // namespace gantry
