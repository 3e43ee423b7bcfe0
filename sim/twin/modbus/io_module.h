#pragma once

#include "gantry/sim/safety_contacts.h"
#include "twin_drive.h"

namespace gantry {

/// A digital input module as the twin serves it: discrete inputs 0 to kInputs - 1 by function 02, and nothing
/// else. Inputs to which nothing is wired read 0. It has no motor: the drives' injections are refused, the
/// contacts have their own (SafetyContacts). docs/safety.md has its wire contract.
class IoModule final : public TwinDrive {
 public:
  static constexpr int kInputs = 16;

  /// `contacts` must outlive the module. Throws InputError when one is wired to an input that is not there.
  explicit IoModule(const SafetyContacts& contacts);

  bool serves(int function) const override;
  ModbusAnswer<std::vector<uint16_t>> read_registers(int address, int count, double now_s) override;
  ModbusAnswer<std::vector<uint8_t>> read_bits(int address, int count, double now_s) override;
  ModbusAnswer<void> write_bit(int address, bool on, double now_s) override;
  ModbusAnswer<void> write_registers(int address, std::span<const uint16_t> words, double now_s) override;

  void raise_alarm(int code, bool persists, double now_s) override;
  void clear_alarm_cause() override;
  void set_emergency_stop(bool active, double now_s) override;

 private:
  const SafetyContacts& contacts_;
};

}  // namespace gantry
